"""What Hush reads of a stage is what USD composes, over stages made by chance, and what it cannot read it refuses in words."""

from __future__ import annotations

import json
import os
import random
import subprocess
from pathlib import Path

import pytest
from conftest import Hush
from pxr import Sdf, Usd

PASS = Sdf.Path("/Render/Pass")
TYPES = Sdf.ValueTypeNames
STAGES = 48
OFFSETS = [(0, 1), (10, 1), (0, 2), (-5, 0.5), (100, 0.96)]
TEXTS = [
    "left",
    "a.b",
    'quo"te',
    "it's",
    "both'\"",
    "back\\slash",
    "\\n",
    "ünï",
    "two\nlines",
    "\ttab",
    "\x07bell",
    "#x {",
    "@a@",
    "",
    "'''",
    "a\"\"\"b'''",
]
LISTS = [[], ["all"], ["Diffuse Direct", 'a"b'], ["x\\y", "ü"]]
# Of each kind of value one setting or two; what is refused has tests of its own.
NUMBERS = ("hush:lambda", "hush:lambdaMasked")
SETTINGS = {"hush:lambda": "lambda", "hush:lambdaMasked": "lambda_masked", "hush:window": "window", "hush:view": "view"} | {
    "hush:passes:beauty": "passes.beauty",
    "hush:layers": "layers",
    "hush:keepNoisy": "keep_noisy",
}


def author(chance: random.Random, layer: Sdf.Layer, prim: Sdf.PrimSpec) -> None:
    """Some settings on a prim or in a variant: values, samples, both, none of both, or a block."""
    for name in chance.sample(sorted(SETTINGS), chance.randint(0, 4)):
        if name in NUMBERS:
            kind, value = chance.choice([(TYPES.Float, 2.25), (TYPES.Double, 3.1), (TYPES.Half, 4.5), (TYPES.Int, 5), (TYPES.UChar, 6)])
        else:
            kind, value = {
                "hush:window": (chance.choice([TYPES.Int, TYPES.UChar, TYPES.Int64, TYPES.UInt]), chance.randint(0, 3)),
                "hush:view": (TYPES.Token, chance.choice(TEXTS)),
                "hush:passes:beauty": (TYPES.String, chance.choice(TEXTS)),
                "hush:layers": (TYPES.TokenArray, chance.choice(LISTS)),
                "hush:keepNoisy": (TYPES.Bool, chance.random() < 0.5),
            }[name]
        variability = chance.choice([Sdf.VariabilityVarying, Sdf.VariabilityUniform])
        attribute = Sdf.AttributeSpec(prim, name, kind, variability, chance.random() < 0.5)
        attribute.documentation = chance.choice(["", "a \"doc\" of 'two'\nlines"])
        how = chance.random()
        if how < 0.1:
            attribute.default = Sdf.ValueBlock()
        elif how < 0.5 and name in NUMBERS:
            for _ in range(chance.randint(1, 3)):
                layer.SetTimeSample(attribute.path, round(chance.uniform(-10, 100), 1), chance.randint(1, 64))
            if how < 0.2:
                attribute.default = value
        elif how < 0.9:
            attribute.default = value


def arcs(chance: random.Random, prim: Sdf.PrimSpec, layer: Sdf.Layer, others: list[str]) -> None:
    """A reference, a payload or a class, and variants with a selection."""
    offset = Sdf.LayerOffset(*chance.choice(OFFSETS))
    kind = chance.choice(["reference", "payload", "inherit", "specialize", "none"])
    if kind == "reference":
        prim.referenceList.Prepend(Sdf.Reference(chance.choice(["", *others]), "/Lib/A", offset))
    elif kind == "payload" and others:
        prim.payloadList.Prepend(Sdf.Payload(chance.choice(others), "/Lib/A", offset))
    elif kind == "inherit":
        prim.inheritPathList.Prepend("/_class")
    elif kind == "specialize":
        prim.specializesList.Prepend("/_class")
    if chance.random() < 0.5:
        variants = Sdf.VariantSetSpec(prim, "quality")
        prim.variantSetNameList.Prepend("quality")
        for name in ("draft", "final"):
            author(chance, layer, Sdf.VariantSpec(variants, name).primSpec)
    if chance.random() < 0.6:
        prim.variantSelections["quality"] = chance.choice(["draft", "final", "missing"])


def stage_by_chance(seed: int, folder: Path) -> Path:
    """Up to four layers in two folders, each over the later ones or referring to them."""
    chance = random.Random(seed)
    count = chance.randint(1, 4)
    files = [folder / chance.choice(["", "sub"]) / f"layer{i}.{chance.choice(['usda', 'usdc'])}" for i in range(count)]
    (folder / "sub").mkdir(parents=True)
    taken: set[str] = set()
    for i, file in enumerate(files):
        layer = Sdf.Layer.CreateNew(str(file))
        others = [os.path.relpath(other, file.parent) for other in files[i + 1 :]]
        if chance.random() < 0.3:
            layer.timeCodesPerSecond, layer.framesPerSecond = chance.choice([(24, 24), (48, 24), (25, 25)])
        # No layer twice in a stack: openusd and USD do not retime it alike.
        above = {other for other in others if chance.random() < 0.7 and os.path.basename(other) not in taken}
        taken |= {os.path.basename(other) for other in above}
        layer.subLayerPaths[:] = [other for other in others if other in above]
        for at in range(len(layer.subLayerPaths)):
            layer.subLayerOffsets[at] = Sdf.LayerOffset(*chance.choice(OFFSETS))
        for path in (PASS, Sdf.Path("/Lib/A"), Sdf.Path("/_class")):
            if i == 0 or path.name == "A" or chance.random() < 0.6:
                prim = Sdf.CreatePrimInLayer(layer, path)
                Sdf.CreatePrimInLayer(layer, path.GetPrefixes()[0]).specifier = Sdf.SpecifierDef
                prim.specifier = Sdf.SpecifierClass if path.name == "_class" else Sdf.SpecifierDef
                if path == PASS:
                    prim.typeName = "RenderPass"
                author(chance, layer, prim)
                if path == PASS:
                    arcs(chance, prim, layer, others)
        layer.Save()
    return files[0]


def expected(stage: Usd.Stage, attribute: Usd.Attribute) -> object:
    """What USD composes, as Hush shows it; None where nothing is said."""
    if not attribute or attribute.GetResolveInfo().GetSource() in (Usd.ResolveInfoSourceNone, Usd.ResolveInfoSourceFallback):
        return None
    times = attribute.GetTimeSamples()
    if not times:
        value = attribute.Get()
        return list(value) if attribute.GetName() == "hush:layers" and value is not None else value
    layer = stage.GetRootLayer()
    both = layer.HasFramesPerSecond() and layer.HasTimeCodesPerSecond()
    rate = layer.framesPerSecond / layer.timeCodesPerSecond if both else 1.0
    # A little later, where a whole number is held: the times are rounded.
    return [[time * rate, float(attribute.Get(time + 1e-6))] for time in times]


def same(one: object, other: object) -> bool:
    if isinstance(one, list) and len(one) == 1 and isinstance(one[0], list) and isinstance(other, float):
        return same(one[0][1], other)
    if isinstance(one, list) and isinstance(other, list):
        return len(one) == len(other) and all(map(same, one, other))
    if isinstance(one, float) or isinstance(other, float):
        return one == pytest.approx(other, rel=1e-5)
    return one == other


def test_stages_made_by_chance_are_read_as_usd_composes_them(hush: Hush, tmp_path: Path) -> None:
    said = refused = 0
    for seed in range(STAGES):
        root = stage_by_chance(seed, tmp_path / str(seed))
        stage = Usd.Stage.Open(str(root))
        assert not stage.GetCompositionErrors(), f"seed {seed} makes no sound stage"
        result = hush("shot", "show", "--json", f"{root}@{PASS}")
        if result.returncode:
            assert "beside a retimed reference" in result.stderr, f"seed {seed}: {result.stderr}"
            refused += 1
            continue
        found = json.loads(result.stdout)["settings"]
        for attribute, setting in SETTINGS.items():
            value, shown = expected(stage, stage.GetAttributeAtPath(PASS.AppendProperty(attribute))), found[setting]["value"]
            assert same(value, shown), f"seed {seed}, {attribute}: USD has {value!r}, Hush {shown!r}"
            said += value is not None
    assert said > 2 * STAGES
    assert refused < STAGES // 8


def failing(hush: Hush, stage: Path | str) -> str:
    result: subprocess.CompletedProcess[str] = hush("shot", "show", stage)
    assert result.returncode == 1, result.stdout
    return result.stderr


def usda(path: Path, text: str) -> Path:
    path.write_text(f"#usda 1.0\n{text}\n", encoding="utf-8")
    return path


def with_pass(inside: str = "", about: str = "") -> str:
    return f'def Scope "Render"\n{{\n    def RenderPass "Pass" (\n{about}\n    )\n    {{\n{inside}\n    }}\n}}\n'


@pytest.mark.parametrize(
    "about",
    ["references = @./gone.usda@", "payload = @./gone.usda@</X>", "payload = @./lib.usda@</Gone>", "references = </Render/Pass>"],
)
def test_what_a_pass_refers_to_must_be_there(hush: Hush, tmp_path: Path, about: str) -> None:
    usda(tmp_path / "lib.usda", 'def "K"\n{\n}')
    told = failing(hush, usda(tmp_path / "shot.usda", with_pass("int hush:window = 1", about)))
    assert "shot.usda" in told
    assert "/Render/Pass" in told
    assert "the settings would not be whole" in told
    # What the scene misses is none of it.
    scene = 'def Xform "tree" (\n    references = @./gone.usda@\n)\n{\n}\n'
    other = usda(tmp_path / "other.usda", with_pass("int hush:window = 1") + scene)
    assert hush("shot", "show", other).returncode == 0
    flat = usda(tmp_path / "flat.usda", scene + 'def RenderPass "Pass"\n{\n    int hush:window = 1\n}\n')
    assert hush("shot", "show", flat).returncode == 0


def test_what_is_resolved_otherwise_than_in_usd_is_refused(hush: Hush, tmp_path: Path) -> None:
    expression = '(\n    expressionVariables = {\n        string SHOW = "/show"\n    }\n)\n' + with_pass(
        'asset hush:output = @`"${SHOW}/out"`@'
    )
    told = failing(hush, usda(tmp_path / "expression.usda", expression))
    assert "</Render/Pass.hush:output> is a variable expression" in told
    clips = 'clips = {\n    dictionary default = {\n        asset[] assetPaths = [@./keys.usda@]\n        string primPath = "/K"\n    }\n}'
    told = failing(hush, usda(tmp_path / "clips.usda", with_pass("float hush:lambda", clips)))
    assert "</Render/Pass> has value clips" in told
    keys = "    float hush:lambda.timeSamples = {\n        0: 1,\n        10: 2,\n    }\n"
    usda(tmp_path / "lib.usda", f'class "_class"\n{{\n{keys}}}\ndef "K" (\n    inherits = </_class>\n)\n{{\n}}')
    about = "references = @./lib.usda@</K> (offset = 10)"
    beside = with_pass("", about) + f'over "_class"\n{{\n{keys}}}'
    told = failing(hush, usda(tmp_path / "class.usda", beside))
    assert "</_class> beside a retimed reference" in told
    shown = json.loads(hush("shot", "show", "--json", usda(tmp_path / "plain.usda", with_pass("", about))).stdout)
    assert shown["settings"]["lambda"]["value"] == [[10.0, 1.0], [20.0, 2.0]]


@pytest.mark.parametrize("kind", ["usda", "usdc"])
def test_a_spline_is_refused(hush: Hush, tmp_path: Path, kind: str) -> None:
    curve = "float hush:lambda = 3\nfloat hush:lambda.spline = {\n    1: 2; post linear,\n    10: 8; post linear,\n}"
    source = usda(tmp_path / "source.usda", with_pass(curve))
    assert Usd.Stage.Open(str(source)).GetAttributeAtPath(f"{PASS}.hush:lambda").Get(5.5) == 5.0
    stage = tmp_path / f"shot.{kind}"
    Sdf.Layer.FindOrOpen(str(source)).Export(str(stage))
    told = failing(hush, stage)
    assert "</Render/Pass.hush:lambda> is a spline" in told
    assert "bake it to time samples" in told


def test_a_stage_whose_name_no_layer_can_hold(hush: Hush, tmp_path: Path) -> None:
    base = usda(tmp_path / "a@@@b.usda", with_pass("int hush:window = 1"))
    result = hush("shot", "write", "--output", tmp_path / "over.usda", "--sublayer", base, "--lambda", "4")
    assert result.returncode == 1
    assert "rename that file" in result.stderr
    assert not (tmp_path / "over.usda").exists()


def test_an_empty_list_of_strings_in_a_crate_file_names_its_attribute(hush: Hush, tmp_path: Path) -> None:
    layer = Sdf.Layer.CreateNew(str(tmp_path / "shot.usdc"))
    prim = Sdf.CreatePrimInLayer(layer, PASS)
    layer.GetPrimAtPath("/Render").specifier = prim.specifier = Sdf.SpecifierDef
    prim.typeName = "RenderPass"
    Sdf.AttributeSpec(prim, "hush:layers", TYPES.StringArray).default = []
    layer.Save()
    assert "</Render/Pass.hush:layers> cannot be read" in failing(hush, tmp_path / "shot.usdc")


def test_text_that_is_not_read_may_come_as_a_crate_file(hush: Hush, tmp_path: Path) -> None:
    stage = usda(tmp_path / "shot.usda", with_pass('string größe = "x"\nint hush:window = 1'))
    assert "usdcat -o" in failing(hush, stage)
    Sdf.Layer.FindOrOpen(str(stage)).Export(str(tmp_path / "shot.usdc"))
    shown = json.loads(hush("shot", "show", "--json", tmp_path / "shot.usdc").stdout)
    assert shown["settings"]["window"]["value"] == 1


def test_classes_and_bare_opinions_are_no_render_prims(hush: Hush, tmp_path: Path) -> None:
    others = '    class RenderPass "_base"\n    {\n        int hush:window = 3\n    }\n    over "Pass2"\n    {\n    }\n'
    text = f'def Scope "Render"\n{{\n{others}    def RenderPass "Pass" (\n        inherits = </Render/_base>\n    )\n    {{\n    }}\n}}\n'
    shown = json.loads(hush("shot", "show", "--json", usda(tmp_path / "shot.usda", text)).stdout)
    assert (shown["settings"]["window"]["value"], shown["settings"]["window"]["prim"]) == (3, "/Render/Pass")


def test_a_product_name_with_backslashes_over_time(hush: Hush, tmp_path: Path) -> None:
    text = r"""def Scope "Render"
{
    def RenderSettings "Settings"
    {
        rel products = </Render/Product>
    }
    def RenderProduct "Product"
    {
        token productName.timeSamples = {
            1: "/shots/it\'s/\x41.0001.exr",
        }
    }
}"""
    shown = json.loads(hush("shot", "show", "--json", usda(tmp_path / "shot.usda", text)).stdout)
    assert shown["settings"]["input"]["value"] == "/shots/it's/A.####.exr"


def test_a_layer_over_a_stage_with_expressions_keeps_their_variables(hush: Hush, tmp_path: Path) -> None:
    usda(tmp_path / "real.usda", with_pass("int hush:window = 1"))
    variables = '(\n    expressionVariables = {\n        string FILE = "real"\n    }\n    subLayers = [@`"./${FILE}.usda"`@]\n)\n'
    base = usda(tmp_path / "base.usda", variables)
    over = tmp_path / "over.usda"
    result = hush("shot", "write", "--output", over, "--sublayer", base, "--lambda", "4")
    assert result.returncode == 0, result.stderr
    stage = Usd.Stage.Open(str(over))
    assert not stage.GetCompositionErrors()
    assert stage.GetAttributeAtPath(f"{PASS}.hush:window").Get() == 1
    assert stage.GetAttributeAtPath(f"{PASS}.hush:lambda").Get() == 4
