"""Random procedural materials for the training shots."""

from __future__ import annotations

import colorsys
import math
import random

import bpy

from training.shots.cycles.assets import Assets

TEXTURES = {
    "noise": "ShaderNodeTexNoise",
    "voronoi": "ShaderNodeTexVoronoi",
    "wave": "ShaderNodeTexWave",
    "magic": "ShaderNodeTexMagic",
    "gradient": "ShaderNodeTexGradient",
    "image": "ShaderNodeTexNoise",  # when there are no images
}


def colour(r: random.Random, low: float = 0.02, high: float = 0.9, saturation: float | None = None) -> tuple[float, float, float, float]:
    """A random RGBA colour with its HSV value between low and high; greyish ones are likelier."""
    s = r.random() ** 1.5 if saturation is None else saturation
    hue = r.random()
    return (*colorsys.hsv_to_rgb(hue, s, r.uniform(low, high)), 1.0)


def coordinates(r: random.Random, tree: bpy.types.NodeTree, scale: float) -> bpy.types.NodeSocket:
    """Texture coordinates at a random scale and turn."""
    source = tree.nodes.new("ShaderNodeTexCoord")
    mapping = tree.nodes.new("ShaderNodeMapping")
    s = scale * math.exp(r.uniform(-0.7, 1.6))
    mapping.inputs["Scale"].default_value = (s, s * math.exp(r.uniform(-0.4, 0.4)), s)
    mapping.inputs["Rotation"].default_value = [r.uniform(0, 3.1) for _ in range(3)]
    tree.links.new(source.outputs[r.choice(["Object", "Generated", "Object"])], mapping.inputs["Vector"])
    return mapping.outputs[0]


def image_colour(r: random.Random, tree: bpy.types.NodeTree, at: bpy.types.NodeSocket, assets: Assets) -> bpy.types.NodeSocket:
    """An image of the assets, recoloured at random and clamped to 1 (HDRIs are among them)."""
    texture = tree.nodes.new("ShaderNodeTexImage")
    texture.image = bpy.data.images.load(r.choice(assets.normals + assets.hdris), check_existing=True)
    texture.projection = "BOX"
    tree.links.new(at, texture.inputs["Vector"])
    tinted = tree.nodes.new("ShaderNodeHueSaturation")
    tinted.inputs["Hue"].default_value = r.random()
    tinted.inputs["Saturation"].default_value = r.random()
    tinted.inputs["Value"].default_value = r.uniform(0.3, 1.0)
    tree.links.new(texture.outputs["Color"], tinted.inputs["Color"])
    clamped = tree.nodes.new("ShaderNodeMix")
    clamped.data_type = "RGBA"
    clamped.clamp_result = True
    clamped.inputs[0].default_value = 0.0
    tree.links.new(tinted.outputs[0], clamped.inputs[6])
    return clamped.outputs[2]


def ramped(
    r: random.Random, tree: bpy.types.NodeTree, kind: str, at: bpy.types.NodeSocket, ends: tuple[tuple[float, ...], tuple[float, ...]]
) -> bpy.types.NodeSocket:
    """A texture node through a ramp between two or three colours."""
    texture = tree.nodes.new(TEXTURES[kind])
    tree.links.new(at, texture.inputs["Vector"])
    if "Scale" in texture.inputs:
        texture.inputs["Scale"].default_value = r.uniform(1.5, 6)
    if "Detail" in texture.inputs:
        texture.inputs["Detail"].default_value = r.uniform(0, 10)
    ramp = tree.nodes.new("ShaderNodeValToRGB")
    elements = ramp.color_ramp.elements
    elements[0].color, elements[1].color = ends
    start = r.uniform(0.15, 0.5)
    elements[0].position = start
    elements[1].position = min(0.95, start + r.choice([0.02, 0.1, 0.3, 0.5]))
    if r.random() < 0.4:
        between = elements.new(r.uniform(0.2, 0.8))
        between.color = colour(r)
    if kind == "voronoi" and r.random() < 0.5:
        output = texture.outputs["Distance"]
    else:
        output = texture.outputs["Color"] if "Color" in texture.outputs else texture.outputs[0]
    tree.links.new(output, ramp.inputs["Fac"])
    return ramp.outputs["Color"]


def texture_colour(r: random.Random, tree: bpy.types.NodeTree, scale: float, assets: Assets) -> bpy.types.NodeSocket:
    """A random colour texture; its output socket."""
    kind = r.choice(["noise", "voronoi", "checker", "brick", "wave", "magic", "noise", "voronoi", "gradient", "image"])
    at = coordinates(r, tree, scale)
    first, second = colour(r), colour(r)
    if kind == "image" and assets.normals:
        return image_colour(r, tree, at, assets)
    if kind not in ("checker", "brick"):
        return ramped(r, tree, kind, at, (first, second))
    texture = tree.nodes.new("ShaderNodeTexChecker" if kind == "checker" else "ShaderNodeTexBrick")
    texture.inputs["Color1"].default_value = first
    texture.inputs["Color2"].default_value = second
    if kind == "checker":
        texture.inputs["Scale"].default_value = 3
    else:
        texture.inputs["Mortar"].default_value = colour(r)
    tree.links.new(at, texture.inputs["Vector"])
    return texture.outputs["Color"]


def texture_value(r: random.Random, tree: bpy.types.NodeTree, scale: float, assets: Assets) -> bpy.types.NodeSocket:
    """The same as grey, for roughness, height and alpha."""
    grey = tree.nodes.new("ShaderNodeRGBToBW")
    tree.links.new(texture_colour(r, tree, scale, assets), grey.inputs[0])
    return grey.outputs[0]


def substance(r: random.Random, tree: bpy.types.NodeTree, shader: bpy.types.Node, scale: float, emits: bool, assets: Assets) -> None:
    """Plastic, metal, glass, skin, lacquer, cloth or a glowing thing."""
    inputs = shader.inputs
    u = r.random()
    inputs["Base Color"].default_value = colour(r)
    inputs["Roughness"].default_value = r.choice([0.05, 0.15, 0.3, 0.5, 0.7, 1.0])
    if u < 0.42:
        inputs["Specular IOR Level"].default_value = r.choice([0, 0.5, 0.5, 0.8])
    elif u < 0.60:
        inputs["Metallic"].default_value = 1.0
        inputs["Roughness"].default_value = r.choice([0.0, 0.05, 0.1, 0.2, 0.35, 0.5])
    elif u < 0.70:
        inputs["Transmission Weight"].default_value = 1.0
        inputs["Roughness"].default_value = r.choice([0, 0, 0.05, 0.2, 0.4])
        inputs["IOR"].default_value = r.uniform(1.2, 1.8)
        inputs["Base Color"].default_value = colour(r, 0.7, 1.0, r.random() * 0.4)
    elif u < 0.78:
        inputs["Subsurface Weight"].default_value = 1.0
        inputs["Subsurface Scale"].default_value = r.uniform(0.05, 0.4)
    elif u < 0.86:
        inputs["Coat Weight"].default_value = 1.0
        inputs["Coat Roughness"].default_value = r.choice([0.02, 0.1, 0.3])
    elif u < 0.91:
        inputs["Sheen Weight"].default_value = 1.0
    elif u < 0.95 and emits:
        inputs["Emission Color"].default_value = colour(r, 0.5, 1.0)
        inputs["Emission Strength"].default_value = math.exp(r.uniform(-1, 3))
        if r.random() < 0.4:
            tree.links.new(texture_colour(r, tree, scale, assets), inputs["Emission Color"])


def relief(r: random.Random, tree: bpy.types.NodeTree, shader: bpy.types.Node, scale: float, assets: Assets) -> None:
    """For a third of the materials a bump map, from a texture or from an image of the assets."""
    v = r.random()
    if v >= 0.32 or (v >= 0.22 and not assets.normals):
        return
    bump = tree.nodes.new("ShaderNodeBump")
    if v < 0.22:
        bump.inputs["Strength"].default_value = r.uniform(0.1, 0.8)
        bump.inputs["Distance"].default_value = r.uniform(0.02, 0.2)
        height = texture_value(r, tree, scale * 2, assets)
    else:
        texture = tree.nodes.new("ShaderNodeTexImage")
        texture.image = bpy.data.images.load(r.choice(assets.normals), check_existing=True)
        texture.image.colorspace_settings.name = "Non-Color"
        texture.projection = "BOX"
        source = tree.nodes.new("ShaderNodeTexCoord")
        bump.inputs["Strength"].default_value = r.uniform(0.2, 1)
        tree.links.new(source.outputs["Object"], texture.inputs["Vector"])
        grey = tree.nodes.new("ShaderNodeRGBToBW")
        tree.links.new(texture.outputs[0], grey.inputs[0])
        height = grey.outputs[0]
    tree.links.new(height, bump.inputs["Height"])
    tree.links.new(bump.outputs[0], shader.inputs["Normal"])


def material(r: random.Random, scale: float, assets: Assets, emits: bool = True) -> bpy.types.Material:
    """A random material; `scale` is that of its textures, `emits` allows a glowing one."""
    made = bpy.data.materials.new("m")
    made.use_nodes = True
    tree = made.node_tree
    shader = tree.nodes["Principled BSDF"]
    substance(r, tree, shader, scale, emits, assets)
    if r.random() < 0.62:
        tree.links.new(texture_colour(r, tree, scale, assets), shader.inputs["Base Color"])
    if r.random() < 0.2:
        tree.links.new(texture_value(r, tree, scale, assets), shader.inputs["Roughness"])
    relief(r, tree, shader, scale, assets)
    if r.random() < 0.06:  # cut-out
        grey = texture_value(r, tree, scale * 2, assets)
        opaque = tree.nodes.new("ShaderNodeMath")
        opaque.operation = "GREATER_THAN"
        opaque.inputs[1].default_value = 0.25
        tree.links.new(grey, opaque.inputs[0])
        tree.links.new(opaque.outputs[0], shader.inputs["Alpha"])
    return made
