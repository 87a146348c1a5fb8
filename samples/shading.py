"""Procedural materials of the sample shot: planks, wallpaper, tartan, painted porcelain, glass, brass, paper, linen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy

Stops = Sequence[tuple[float, tuple[float, float, float]]]


def place(tree: bpy.types.NodeTree, kind: str, inputs: dict[str | int, Any] | None = None, **settings: Any) -> bpy.types.Node:  # noqa: ANN401
    """A new node of `kind`; `inputs` are values, or sockets to link; `settings` are the node's own properties."""
    made = tree.nodes.new("ShaderNode" + kind)
    for name, value in settings.items():
        setattr(made, name, value)
    for key, value in (inputs or {}).items():
        if isinstance(value, bpy.types.NodeSocket):
            tree.links.new(value, made.inputs[key])
        else:
            made.inputs[key].default_value = value
    return made


def ramp(tree: bpy.types.NodeTree, factor: bpy.types.NodeSocket, stops: Stops, interpolation: str = "LINEAR") -> bpy.types.NodeSocket:
    """A colour ramp over `factor`; stops are (position, linear RGB)."""
    made = place(tree, "ValToRGB", {"Fac": factor})
    made.color_ramp.interpolation = interpolation
    elements = made.color_ramp.elements
    while len(elements) < len(stops):
        elements.new(1.0)
    for element, (position, colour) in zip(elements, stops, strict=True):
        element.position = position
        element.color = (*colour, 1.0)
    return made.outputs["Color"]


def grey(level: float) -> tuple[float, float, float]:
    return (level, level, level)


def mixed(tree: bpy.types.NodeTree, factor: Any, a: Any, b: Any, blend: str = "MIX") -> bpy.types.NodeSocket:  # noqa: ANN401
    """Mix of two colours (values or sockets)."""
    a, b = ((*c, 1.0) if isinstance(c, tuple) and len(c) == 3 else c for c in (a, b))
    return place(tree, "Mix", {0: factor, 6: a, 7: b}, data_type="RGBA", blend_type=blend).outputs[2]


def coordinates(
    tree: bpy.types.NodeTree, scale: Sequence[float], turn: float = 0.0, kind: str = "Object", shift: Sequence[float] = (0, 0, 0)
) -> bpy.types.NodeSocket:
    source = place(tree, "TexCoord").outputs[kind]
    return place(tree, "Mapping", {"Vector": source, "Scale": scale, "Rotation": (0, 0, turn), "Location": shift}).outputs[0]


def principled(name: str, **inputs: Any) -> tuple[bpy.types.Material, bpy.types.NodeTree, bpy.types.Node]:  # noqa: ANN401
    """A material with a Principled BSDF; keywords are its inputs with _ for spaces."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    tree = material.node_tree
    shader = tree.nodes["Principled BSDF"]
    for key, value in inputs.items():
        shader.inputs[key.replace("_", " ")].default_value = value
    return material, tree, shader


def bump(tree: bpy.types.NodeTree, shader: bpy.types.Node, height: bpy.types.NodeSocket, strength: float, distance: float) -> None:
    made = place(tree, "Bump", {"Height": height, "Strength": strength, "Distance": distance})
    tree.links.new(made.outputs[0], shader.inputs["Normal"])


def planks() -> bpy.types.Material:
    """Oiled walnut boards: each board has its own tone and grain."""
    material, tree, shader = principled("planks", Coat_Weight=0.25, Coat_Roughness=0.12)
    brick = place(
        tree,
        "TexBrick",
        {"Vector": coordinates(tree, (1, 1, 1), 0.06), "Color1": (0, 0, 0, 1), "Color2": (1, 1, 1, 1), "Mortar": (0.5, 0.5, 0.5, 1)}
        | {"Scale": 1.0, "Mortar Size": 0.014, "Mortar Smooth": 0.3, "Brick Width": 4.3, "Row Height": 0.62},
        offset=0.37,
    )
    along = coordinates(tree, (0.55, 9.0, 1), 0.06)
    shifted = place(tree, "VectorMath", {0: brick.outputs["Color"], 1: (17.0, 31.0, 7.0)}, operation="MULTIPLY_ADD")
    tree.links.new(along, shifted.inputs[2])
    grain = place(tree, "TexNoise", {"Vector": shifted.outputs[0], "Scale": 1.6, "Detail": 9.0, "Roughness": 0.65, "Distortion": 0.7})
    wood = ramp(
        tree,
        grain.outputs["Fac"],
        [(0.3, (0.045, 0.017, 0.007)), (0.47, (0.17, 0.075, 0.03)), (0.56, (0.28, 0.14, 0.06)), (0.72, (0.40, 0.22, 0.10))],
    )
    tone = ramp(tree, brick.outputs["Color"], [(0.0, (0.55, 0.50, 0.48)), (1.0, (1.0, 1.0, 1.0))])
    board = mixed(tree, 1.0, wood, tone, "MULTIPLY")
    tree.links.new(mixed(tree, brick.outputs["Fac"], board, (0.012, 0.006, 0.003)), shader.inputs["Base Color"])
    tree.links.new(ramp(tree, grain.outputs["Fac"], [(0.3, grey(0.5)), (0.7, grey(0.28))]), shader.inputs["Roughness"])
    bump(tree, shader, ramp(tree, brick.outputs["Fac"], [(0.0, grey(1.0)), (1.0, grey(0.0))]), 0.6, 0.03)
    return material


def wallpaper() -> bpy.types.Material:
    """Dark green paper with a lattice of gold rings and dots (on a plane that stands in x and z)."""
    material, tree, shader = principled("wallpaper", Roughness=0.75)
    turned = place(
        tree, "Mapping", {"Vector": place(tree, "TexCoord").outputs["Object"], "Rotation": (0, 0, 0.7854), "Scale": (2.1, 2.1, 1)}
    )
    cell = place(tree, "TexVoronoi", {"Vector": turned.outputs[0], "Scale": 1.0, "Randomness": 0.0}, voronoi_dimensions="2D")
    gold, green, pale = (0.42, 0.27, 0.09), (0.022, 0.075, 0.068), (0.05, 0.14, 0.125)
    rings = ramp(
        tree,
        cell.outputs["Distance"],
        [(0.0, gold), (0.07, green), (0.20, pale), (0.235, gold), (0.27, green), (0.42, pale), (0.455, green), (0.60, gold), (0.64, green)],
        "CONSTANT",
    )
    fibre = place(tree, "TexNoise", {"Vector": coordinates(tree, (60, 4, 1)), "Scale": 1.0, "Detail": 3.0})
    worn = ramp(tree, fibre.outputs["Fac"], [(0.3, grey(0.7)), (0.7, grey(1.0))])
    tree.links.new(mixed(tree, 1.0, rings, worn, "MULTIPLY"), shader.inputs["Base Color"])
    return material


def tartan() -> bpy.types.Material:
    """A woven check: bands in x and in y, with the single threads visible."""
    material, tree, shader = principled("tartan", Roughness=0.9, Sheen_Weight=0.4, Sheen_Roughness=0.4)
    place_in = place(tree, "SeparateXYZ", {0: coordinates(tree, (1, 1, 1), kind="UV")})
    cream, rust, ink, ochre = (0.62, 0.53, 0.38), (0.36, 0.055, 0.025), (0.02, 0.03, 0.055), (0.55, 0.30, 0.05)
    bands: Stops = [
        (0.0, cream),
        (0.22, rust),
        (0.46, cream),
        (0.50, ink),
        (0.56, cream),
        (0.62, ink),
        (0.66, cream),
        (0.80, ochre),
        (0.83, cream),
    ]
    threads = []
    for axis, repeats in (("X", 9.0), ("Y", 4.0)):
        along = place(tree, "Math", {0: place_in.outputs[axis], 1: repeats}, operation="MULTIPLY")
        threads.append(ramp(tree, place(tree, "Math", {0: along.outputs[0]}, operation="FRACT").outputs[0], bands, "CONSTANT"))
    weave = place(
        tree,
        "TexChecker",
        {"Vector": coordinates(tree, (9, 4, 1), kind="UV"), "Color1": (1, 1, 1, 1), "Color2": (0, 0, 0, 1), "Scale": 18.0},
    )
    cloth = mixed(tree, weave.outputs["Fac"], threads[0], threads[1])
    tree.links.new(cloth, shader.inputs["Base Color"])
    bump(tree, shader, weave.outputs["Fac"], 0.25, 0.01)
    return material


def porcelain() -> bpy.types.Material:
    """White glaze over cobalt brushwork: rosettes, fine vines, hair-fine crackle."""
    material, tree, shader = principled("porcelain", Roughness=0.22, Coat_Weight=1.0, Coat_Roughness=0.02, Specular_IOR_Level=0.5)
    white, cobalt, pale = (0.80, 0.81, 0.79), (0.012, 0.035, 0.30), (0.22, 0.32, 0.62)
    at = coordinates(tree, (1, 1, 1), kind="Generated")
    vines = place(tree, "TexWave", {"Vector": at, "Scale": 4.2, "Distortion": 14.0, "Detail": 2.0, "Detail Scale": 1.1}, wave_type="RINGS")
    strokes = ramp(tree, vines.outputs["Fac"], [(0.0, cobalt), (0.045, cobalt), (0.09, pale), (0.12, white)])
    cells = place(tree, "TexVoronoi", {"Vector": at, "Scale": 8.0, "Randomness": 0.55})
    bloom: Stops = [(0.0, (0.5, 0.38, 0.08)), (0.05, cobalt), (0.11, pale), (0.15, white), (0.19, cobalt), (0.22, white)]
    painted = mixed(tree, 1.0, strokes, ramp(tree, cells.outputs["Distance"], bloom), "MULTIPLY")
    cracks = place(tree, "TexVoronoi", {"Vector": at, "Scale": 24.0}, feature="DISTANCE_TO_EDGE")
    crackle = ramp(tree, cracks.outputs["Distance"], [(0.0, grey(0.62)), (0.02, grey(1.0))])
    tree.links.new(mixed(tree, 1.0, painted, crackle, "MULTIPLY"), shader.inputs["Base Color"])
    return material


def glass(name: str, colour: tuple[float, float, float]) -> bpy.types.Material:
    """Clear glass that lets light through to what is behind it, so that no caustics are needed."""
    material, tree, shader = principled(name, Roughness=0.0, Transmission_Weight=1.0, IOR=1.47, Base_Color=(*colour, 1.0))
    path = place(tree, "LightPath")
    passing = place(tree, "BsdfTransparent", {"Color": (*(0.9 * c for c in colour), 1.0)})
    thin = place(tree, "Math", {0: path.outputs["Is Shadow Ray"], 1: path.outputs["Is Diffuse Ray"]}, operation="MAXIMUM")
    either = place(tree, "MixShader", {0: thin.outputs[0], 1: shader.outputs[0], 2: passing.outputs[0]})
    tree.links.new(either.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return material


def brass() -> bpy.types.Material:
    """Turned brass, a little tarnished."""
    material, tree, shader = principled("brass", Metallic=1.0, Base_Color=(0.80, 0.52, 0.20, 1.0))
    tarnish = place(tree, "TexNoise", {"Vector": coordinates(tree, (1, 1, 1)), "Scale": 5.0, "Detail": 6.0})
    tree.links.new(ramp(tree, tarnish.outputs["Fac"], [(0.35, grey(0.12)), (0.7, grey(0.42))]), shader.inputs["Roughness"])
    return material


def globe() -> bpy.types.Material:
    """A small painted globe: seas, continents and meridians."""
    material, tree, shader = principled("globe", Roughness=0.3, Coat_Weight=0.6, Coat_Roughness=0.05)
    land = place(tree, "TexNoise", {"Vector": coordinates(tree, (1, 1, 1)), "Scale": 2.6, "Detail": 8.0})
    sea: Stops = [
        (0.0, (0.02, 0.10, 0.16)),
        (0.50, (0.05, 0.22, 0.28)),
        (0.515, (0.52, 0.38, 0.16)),
        (0.62, (0.30, 0.26, 0.08)),
        (0.75, (0.6, 0.5, 0.3)),
    ]
    lines = place(
        tree,
        "TexChecker",
        {"Vector": coordinates(tree, (1, 1, 1), kind="UV"), "Color1": (1, 1, 1, 1), "Color2": (0.72, 0.70, 0.66, 1), "Scale": 24.0},
    )
    tree.links.new(mixed(tree, 1.0, ramp(tree, land.outputs["Fac"], sea), lines.outputs["Color"], "MULTIPLY"), shader.inputs["Base Color"])
    return material


def lacquer(name: str, colours: Sequence[tuple[float, float, float]], sectors: float) -> bpy.types.Material:
    """Painted sectors around the z axis, under lacquer: a turning thing shows that it turns."""
    material, tree, shader = principled(name, Roughness=0.25, Coat_Weight=1.0, Coat_Roughness=0.04)
    around = place(tree, "TexGradient", {"Vector": coordinates(tree, (1, 1, 1))}, gradient_type="RADIAL")
    along = place(tree, "Math", {0: around.outputs["Fac"], 1: sectors}, operation="MULTIPLY")
    step = place(tree, "Math", {0: along.outputs[0]}, operation="FRACT")
    stops = [(i / len(colours), colour) for i, colour in enumerate(colours)]
    tree.links.new(ramp(tree, step.outputs[0], stops, "CONSTANT"), shader.inputs["Base Color"])
    return material


def marble() -> bpy.types.Material:
    """A glossy stone ball with veins."""
    material, tree, shader = principled("marble", Roughness=0.08, Coat_Weight=0.5)
    veins = place(tree, "TexNoise", {"Vector": coordinates(tree, (1, 1, 1)), "Scale": 3.0, "Detail": 10.0, "Distortion": 2.2})
    stone: Stops = [
        (0.36, (0.16, 0.012, 0.01)),
        (0.47, (0.42, 0.06, 0.03)),
        (0.50, (0.85, 0.70, 0.55)),
        (0.53, (0.42, 0.06, 0.03)),
        (0.66, (0.10, 0.01, 0.012)),
    ]
    tree.links.new(ramp(tree, veins.outputs["Fac"], stone), shader.inputs["Base Color"])
    return material


def leather(name: str, colour: tuple[float, float, float]) -> bpy.types.Material:
    """Grained book cloth."""
    material, tree, shader = principled(name, Roughness=0.5)
    grain = place(tree, "TexVoronoi", {"Vector": coordinates(tree, (1, 1, 1)), "Scale": 26.0})
    dark = tuple(0.55 * c for c in colour)
    tree.links.new(ramp(tree, grain.outputs["Distance"], [(0.1, colour), (0.7, dark)]), shader.inputs["Base Color"])
    bump(tree, shader, grain.outputs["Distance"], 0.3, 0.01)
    return material


def paper() -> bpy.types.Material:
    """The edges of a book's pages."""
    material, tree, shader = principled("paper", Roughness=0.9)
    sheets = place(tree, "TexNoise", {"Vector": coordinates(tree, (0.6, 0.6, 60.0)), "Scale": 1.0, "Detail": 3.0})
    tree.links.new(ramp(tree, sheets.outputs["Fac"], [(0.3, (0.36, 0.28, 0.17)), (0.65, (0.80, 0.72, 0.56))]), shader.inputs["Base Color"])
    return material


def linen() -> bpy.types.Material:
    """The lamp's shade: woven, and light comes through."""
    material, tree, shader = principled("linen", Roughness=0.9)
    weave = place(tree, "TexNoise", {"Vector": coordinates(tree, (40, 40, 90)), "Scale": 1.0, "Detail": 2.0})
    colour = ramp(tree, weave.outputs["Fac"], [(0.3, (0.50, 0.36, 0.20)), (0.7, (0.86, 0.72, 0.50))])
    tree.links.new(colour, shader.inputs["Base Color"])
    through = place(tree, "BsdfTranslucent", {"Color": colour})
    both = place(tree, "MixShader", {0: 0.45, 1: shader.outputs[0], 2: through.outputs[0]})
    tree.links.new(both.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return material


def leaf() -> bpy.types.Material:
    """Waxy leaves, veined, a little translucent."""
    material, tree, shader = principled("leaf", Roughness=0.35, Coat_Weight=0.3)
    veins = place(tree, "TexWave", {"Vector": coordinates(tree, (1, 1, 1), 0.6), "Scale": 9.0, "Distortion": 1.2, "Detail": 2.0})
    colour = ramp(tree, veins.outputs["Fac"], [(0.0, (0.012, 0.055, 0.016)), (0.85, (0.035, 0.15, 0.03)), (1.0, (0.16, 0.30, 0.08))])
    tree.links.new(colour, shader.inputs["Base Color"])
    through = place(tree, "BsdfTranslucent", {"Color": colour})
    both = place(tree, "MixShader", {0: 0.25, 1: shader.outputs[0], 2: through.outputs[0]})
    tree.links.new(both.outputs[0], tree.nodes["Material Output"].inputs["Surface"])
    return material
