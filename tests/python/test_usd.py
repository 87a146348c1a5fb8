"""Settings in real stages: written by USD itself, as Houdini writes them, and those that Hush writes read by USD."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT, Hush
from pxr import Sdf, Usd, UsdGeom, UsdRender, UsdUtils

PASS = "/Render/Pass"


def shown(hush: Hush, *arguments: str | Path) -> dict[str, Any]:
    """What hush shot show tells about every setting."""
    result = hush("shot", "show", "--json", *arguments)
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)["settings"]


def attribute(prim: Usd.Prim, name: str, kind: Sdf.ValueTypeName, value: object = None) -> Usd.Attribute:
    made = prim.CreateAttribute(name, kind, custom=False)
    if value is not None:
        made.Set(value)
    return made


def base(path: Path) -> Usd.Stage:
    """A stage with a pass that has λ keys, a window and a list."""
    stage = Usd.Stage.CreateNew(str(path))
    prim = UsdRender.Pass.Define(stage, PASS).GetPrim()
    dial = attribute(prim, "hush:lambda", Sdf.ValueTypeNames.Float)
    dial.Set(1.5, 10.0)
    dial.Set(8.0, 20.0)
    attribute(prim, "hush:window", Sdf.ValueTypeNames.Int, 1)
    attribute(prim, "hush:layers", Sdf.ValueTypeNames.TokenArray, ["Characters", "Set"])
    stage.Save()
    return stage


def keys_of(stage: Usd.Stage, path: str) -> list[list[float]]:
    dial = stage.GetAttributeAtPath(f"{path}.hush:lambda")
    return [[time, dial.Get(time)] for time in dial.GetTimeSamples()]


@pytest.mark.parametrize("kind", ["usda", "usdc", "usdz"])
def test_every_kind_of_file_is_read(hush: Hush, tmp_path: Path, kind: str) -> None:
    stage = base(tmp_path / "base.usda")
    path = tmp_path / f"shot.{kind}"
    if kind == "usdz":
        assert UsdUtils.CreateNewUsdzPackage(str(tmp_path / "base.usda"), str(path))
    else:
        stage.Export(str(path))
    settings = shown(hush, path)
    assert settings["lambda"]["value"] == keys_of(stage, PASS) == [[10.0, 1.5], [20.0, 8.0]]
    assert settings["window"]["value"] == 1
    assert settings["layers"]["value"] == ["Characters", "Set"]
    assert settings["layers"]["prim"] == PASS
    assert Path(settings["layers"]["file"]).name.startswith(path.name)


def test_sublayers_with_offsets_and_other_time_codes(hush: Hush, tmp_path: Path) -> None:
    stage = base(tmp_path / "base.usdc")
    stage.SetTimeCodesPerSecond(48)
    stage.SetFramesPerSecond(24)
    stage.Save()
    top = Usd.Stage.CreateNew(str(tmp_path / "top.usda"))
    top.SetTimeCodesPerSecond(24)
    top.GetRootLayer().subLayerPaths.append("base.usdc")
    top.GetRootLayer().subLayerOffsets[0] = Sdf.LayerOffset(100.0)
    attribute(top.OverridePrim(PASS), "hush:window", Sdf.ValueTypeNames.Int, 3)
    top.Save()
    settings = shown(hush, tmp_path / "top.usda")
    assert settings["lambda"]["value"] == keys_of(top, PASS) == [[105.0, 1.5], [110.0, 8.0]]
    assert (settings["window"]["value"], Path(settings["window"]["file"]).name) == (3, "top.usda")
    assert Path(settings["lambda"]["file"]).name == "base.usdc"
    # The stage itself says that two time codes are a frame.
    assert shown(hush, tmp_path / "base.usdc")["lambda"]["value"] == [[5.0, 1.5], [10.0, 8.0]]


def test_references_and_variants(hush: Hush, tmp_path: Path) -> None:
    base(tmp_path / "base.usda")
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    prim = stage.DefinePrim("/Render/Q")
    prim.GetReferences().AddReference("base.usda", PASS, Sdf.LayerOffset(10.0, 2.0))
    quality = prim.GetVariantSets().AddVariantSet("quality")
    for name, window in (("draft", 0), ("final", 3)):
        quality.AddVariant(name)
        quality.SetVariantSelection(name)
        with quality.GetVariantEditContext():
            # A variant is weaker than a local opinion and stronger than a reference.
            attribute(prim, "hush:window", Sdf.ValueTypeNames.Int, window)
    for name, window in (("draft", 0), ("final", 3)):
        quality.SetVariantSelection(name)
        stage.Save()
        settings = shown(hush, tmp_path / "shot.usda")
        assert settings["window"]["value"] == stage.GetAttributeAtPath("/Render/Q.hush:window").Get() == window
        assert settings["lambda"]["value"] == keys_of(stage, "/Render/Q") == [[30.0, 1.5], [50.0, 8.0]]


def test_a_pass_stands_over_its_settings_and_under_its_denoise_pass(hush: Hush, tmp_path: Path) -> None:
    stage = Usd.Stage.CreateNew(str(tmp_path / "shot.usda"))
    settings = UsdRender.Settings.Define(stage, "/Render/Settings").GetPrim()
    render = UsdRender.Pass.Define(stage, PASS)
    denoise = stage.DefinePrim("/Render/Denoise", "RenderDenoisePass")
    render.GetRenderSourceRel().AddTarget(settings.GetPath())
    render.GetPrim().CreateRelationship("denoise:pass", custom=False).AddTarget(denoise.GetPath())
    for prim, window, dial in ((settings, 1, 2.0), (render.GetPrim(), 2, 4.0), (denoise, 3, None)):
        attribute(prim, "hush:window", Sdf.ValueTypeNames.Int, window)
        attribute(prim, "hush:lambda", Sdf.ValueTypeNames.Float, dial)
    attribute(settings, "hush:view", Sdf.ValueTypeNames.Token, "left")
    stage.Save()
    for start in ("", "@/Render/Pass", "@/Render/Denoise"):
        found = shown(hush, f"{tmp_path / 'shot.usda'}{start}")
        assert [(found[n]["value"], found[n]["prim"]) for n in ("window", "lambda", "view")] == [
            (3, "/Render/Denoise"),
            (4.0, PASS),
            ("left", "/Render/Settings"),
        ]
    assert shown(hush, f"{tmp_path / 'shot.usda'}@/Render/Settings")["window"]["value"] == 1


def test_a_stronger_constant_beats_weaker_time_samples_and_a_block_beats_both(hush: Hush, tmp_path: Path) -> None:
    base(tmp_path / "base.usda")
    top = Usd.Stage.CreateNew(str(tmp_path / "top.usda"))
    top.GetRootLayer().subLayerPaths.append("base.usda")
    dial = attribute(top.OverridePrim(PASS), "hush:lambda", Sdf.ValueTypeNames.Float, 16.0)
    top.Save()
    assert dial.Get(15.0) == shown(hush, tmp_path / "top.usda")["lambda"]["value"] == 16.0
    dial.Set(4.0, 5.0)
    top.Save()
    assert dial.Get(15.0) == 4.0
    assert shown(hush, tmp_path / "top.usda")["lambda"]["value"] == 4.0
    dial.Block()
    top.Save()
    assert dial.Get(15.0) is None
    assert shown(hush, tmp_path / "top.usda")["lambda"]["source"] == "default"


HOUDINI = """#usda 1.0
(
    endTimeCode = 1048
    framesPerSecond = 24
    renderSettingsPrimPath = "/Render/rendersettings"
    startTimeCode = 1001
    timeCodesPerSecond = 24
    upAxis = "Y"
)

def Scope "Render"
{
    def RenderSettings "rendersettings" (
        prepend apiSchemas = ["KarmaRendererSettingsAPI"]
    )
    {
        rel camera = </cameras/camera1>
        rel products = [
            </Render/Products/deep>,
            </Render/Products/renderproduct>,
        ]
        uniform int2 resolution = (1920, 1080)
        int karma:global:samplesperpixel = 16
        float hush:lambda = 4
    }

    def Scope "Products"
    {
        def RenderProduct "deep"
        {
            token productName = "render/deep.1001.rat"
            uniform token productType = "deepRaster"
        }

        def RenderProduct "renderproduct"
        {
            rel orderedVars = [
                </Render/Products/Vars/Beauty>,
                </Render/Products/Vars/albedo>,
                </Render/Products/Vars/hitN>,
                </Render/Products/Vars/hitPz>,
                </Render/Products/Vars/directdiffuse>,
            ]
            token productName
            token productName.timeSamples = {
                1001: "render/shot_v002.1001.exr",
                1002: "render/shot_v002.1002.exr",
            }
            uniform token productType = "raster"
        }

        def Scope "Vars"
        {
            def RenderVar "Beauty"
            {
                uniform token dataType = "color4f"
                uniform string sourceName = "C.*[LO]"
                uniform token sourceType = "lpe"
                custom string driver:parameters:aov:name = "C"
            }

            def RenderVar "albedo"
            {
                uniform token dataType = "color3f"
                uniform string sourceName = "albedo"
                custom string driver:parameters:aov:name = "albedo"
            }

            def RenderVar "hitN"
            {
                uniform token dataType = "normal3f"
                uniform string sourceName = "ray:hitN"
                custom string driver:parameters:aov:name = "N"
            }

            def RenderVar "hitPz"
            {
                uniform token dataType = "float"
                uniform string sourceName = "ray:hitPz"
            }

            def RenderVar "directdiffuse"
            {
                uniform token dataType = "color3f"
                uniform string sourceName = "C<RD>L"
                uniform token sourceType = "lpe"
                custom string driver:parameters:aov:name = "directdiffuse"
            }
        }
    }
}
"""


def test_render_prims_as_houdini_writes_them(hush: Hush, tmp_path: Path) -> None:
    (tmp_path / "shot.usda").write_text(HOUDINI)
    assert Usd.Stage.Open(str(tmp_path / "shot.usda")).GetPrimAtPath("/Render/rendersettings").IsA("RenderSettings")
    settings = shown(hush, tmp_path / "shot.usda")
    names = {name: settings[f"passes.{name}"]["value"] for name in ("beauty", "albedo", "normal", "depth", "vector")}
    # Without a name for the driver the layer is called as the prim.
    assert names == {"beauty": "C", "albedo": "albedo", "normal": "N", "depth": "hitPz", "vector": None}
    assert settings["passes.normal"]["prim"] == "/Render/Products/Vars/hitN"
    assert settings["input"]["value"] == str(tmp_path / "render/shot_v002.####.exr")
    assert settings["input"]["attribute"] == "productName"
    assert settings["lambda"]["value"] == 4.0


def blender_stage(path: Path) -> Usd.Stage:
    """As Blender's exporter writes it: a scene without render prims, time codes that are frames, and no frames per second."""
    stage = Usd.Stage.CreateNew(str(path))
    stage.SetTimeCodesPerSecond(30)
    stage.SetStartTimeCode(1)
    stage.SetEndTimeCode(250)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = UsdGeom.Xform.Define(stage, "/root")
    stage.SetDefaultPrim(root.GetPrim())
    UsdGeom.Cube.Define(stage, "/root/Cube/Cube")
    stage.Save()
    return stage


def test_a_layer_lies_over_a_scene_from_blender(hush: Hush, tmp_path: Path) -> None:
    blender_stage(tmp_path / "scene.usdc")
    over = tmp_path / "layers" / "shot_hush.usda"
    over.parent.mkdir()
    options = ("--lambda", "1:1,48:8.5", "--window", "1", "--aov", "Diffuse Direct", "--keep-noisy", "--frames", "1-48")
    sublayer = ("--sublayer", tmp_path / "scene.usdc")
    missing = hush("shot", "write", "--output", over, *sublayer, "--prim", PASS, *options)
    assert missing.returncode == 1
    assert f"has no prim <{PASS}>" in missing.stderr
    done = hush("shot", "write", "--output", over, *sublayer, *options)
    assert done.returncode == 0, done.stderr
    stage = Usd.Stage.Open(str(over))
    assert stage.GetPrimAtPath("/root/Cube/Cube").IsA(UsdGeom.Cube)
    assert stage.GetPrimAtPath("/Render/Denoise").IsA(UsdRender.Pass)
    assert stage.GetDefaultPrim().GetPath() == "/root"
    assert (stage.GetTimeCodesPerSecond(), stage.GetEndTimeCode(), UsdGeom.GetStageUpAxis(stage)) == (30, 250, "Z")
    settings = shown(hush, over)
    assert settings["lambda"]["value"] == keys_of(stage, "/Render/Denoise") == [[1.0, 1.0], [48.0, 8.5]]
    assert settings["aovs"]["value"] == list(stage.GetAttributeAtPath("/Render/Denoise.hush:aovs").Get())


def test_a_written_layer_opens_in_usd_and_says_the_same(hush: Hush, tmp_path: Path) -> None:
    stage = base(tmp_path / "base.usda")
    stage.SetTimeCodesPerSecond(48)
    stage.SetFramesPerSecond(24)
    stage.SetStartTimeCode(2)
    stage.SetDefaultPrim(stage.GetPrimAtPath("/Render"))
    stage.Save()
    over = tmp_path / "shot_hush.usda"
    options = ("--lambda", "1:1,24.5:8", "--window", "0", "--layer", "all", "--guides", "albedo,normal", "--to", tmp_path / "clean")
    result = hush("shot", "write", "--output", over, "--sublayer", tmp_path / "base.usda", *options, "--memory", "4G", "--enable=false")
    assert result.returncode == 0, result.stderr
    combined = Usd.Stage.Open(str(over))
    prim = combined.GetPrimAtPath(PASS)
    assert prim.IsA(UsdRender.Pass)
    assert "HushAPI" in prim.GetMetadata("apiSchemas").GetAddedOrExplicitItems()
    assert (combined.GetTimeCodesPerSecond(), combined.GetStartTimeCode()) == (48, 2)
    assert combined.GetDefaultPrim().GetPath() == "/Render"
    dial = prim.GetAttribute("hush:lambda")
    assert dial.GetTimeSamples() == [2.0, 49.0], "frames are two time codes each"
    assert dial.Get(25.5) == pytest.approx(4.5)
    values = {name: prim.GetAttribute(name).Get() for name in ("hush:window", "hush:memory", "denoise:enable", "hush:output")}
    assert values == {"hush:window": 0, "hush:memory": str(4 << 30), "denoise:enable": False, "hush:output": str(tmp_path / "clean")}
    assert list(prim.GetAttribute("hush:layers").Get()) == ["all"]
    assert list(prim.GetAttribute("hush:guides").Get()) == ["albedo", "normal"]
    settings = shown(hush, over)
    assert settings["lambda"]["value"] == [[1.0, 1.0], [24.5, 8.0]]
    assert (settings["window"]["value"], settings["enable"]["value"]) == (0, False)
    # The stage may also take the layer in.
    alone = tmp_path / "alone.usda"
    assert hush("shot", "write", "--output", alone, "--prim", PASS, "--window", "2").returncode == 0
    other = Usd.Stage.CreateNew(str(tmp_path / "other.usda"))
    other.GetRootLayer().subLayerPaths = ["alone.usda", "base.usda"]
    other.Save()
    assert other.GetAttributeAtPath(f"{PASS}.hush:window").Get() == shown(hush, tmp_path / "other.usda")["window"]["value"] == 2


def test_texts_survive_the_way_there_and_back(hush: Hush, tmp_path: Path) -> None:
    layers = ["Ünïcode", 'quo"te', "it's", "back\\slash", "both ' and \"", "ends with \\", "two words", "a.b"]
    arguments = [word for layer in layers for word in ("--layer", layer)]
    assert hush("shot", "write", "--output", tmp_path / "x.usda", *arguments).returncode == 0
    stage = Usd.Stage.Open(str(tmp_path / "x.usda"))
    assert list(stage.GetAttributeAtPath("/Render/Denoise.hush:layers").Get()) == layers
    assert stage.GetAttributeAtPath("/Render/Denoise.hush:layers").GetVariability() == Sdf.VariabilityUniform
    for name in ("y.usda", "y.usdc", "y.usd"):
        stage.Export(str(tmp_path / name))
    for name in ("x.usda", "y.usda", "y.usdc", "y.usd"):
        assert shown(hush, tmp_path / name)["layers"]["value"] == layers, name


def test_the_schema_can_be_registered(hush: Hush, tmp_path: Path) -> None:
    """In a process of its own, as plugins are found once."""
    script = """
from pxr import Sdf, Usd, UsdRender
definition = Usd.SchemaRegistry().FindAppliedAPIPrimDefinition("HushAPI")
stage = Usd.Stage.CreateInMemory()
prim = UsdRender.Pass.Define(stage, "/Render/Pass").GetPrim()
assert prim.ApplyAPI("HushAPI")
assert prim.GetAttribute("hush:lambda").GetTypeName() == Sdf.ValueTypeNames.Float
print(*((name, str(prim.GetAttribute(name).GetTypeName())) for name in definition.GetPropertyNames()), sep="\\n")
"""
    environment = {**os.environ, "PXR_PLUGINPATH_NAME": str(ROOT / "farm" / "usd")}
    result = subprocess.run(
        [sys.executable, "-c", script], env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
    )
    assert result.returncode == 0, result.stderr
    source = Sdf.Layer.OpenAsAnonymous(str(ROOT / "farm" / "usd" / "schema.usda"))
    assert source, "the schema's source cannot be read"
    written = {str((a.name, str(a.typeName))) for a in source.GetPrimAtPath("/HushAPI").attributes}
    assert set(result.stdout.splitlines()) == written
    shown_by_hush = json.loads(hush("shot", "show", "--json", "--no-settings").stdout)["settings"]
    assert len(written) == len(shown_by_hush) - 1, "all settings but denoise:enable, which USD has"


def test_damaged_stages_end_in_an_error(hush: Hush, tmp_path: Path) -> None:
    stage = base(tmp_path / "base.usda")
    stage.Export(str(tmp_path / "base.usdc"))
    whole = (tmp_path / "base.usdc").read_bytes()
    bad = tmp_path / "bad.usdc"
    damages = [whole[:length] for length in (0, 8, 100, len(whole) // 2, len(whole) - 1)]
    for at in range(8, len(whole), len(whole) // 25):
        damages += [whole[:at] + filler * 8 + whole[at + 8 :] for filler in (b"\xff", b"\x7f", b"\x00")]
    refused = 0
    for damage in damages:
        bad.write_bytes(damage)
        result = hush("shot", "show", bad)
        assert result.returncode in (0, 1), result.stderr
        assert "panicked" not in result.stderr
        if result.returncode:
            refused += 1
            assert "bad.usdc" in result.stderr
    assert refused > 20
