"""The messages: each is used, has all its fields, and speaks to artists."""

from __future__ import annotations

import re
import string
from pathlib import Path

import kit

messages = kit.module("messages")
SOURCES = sorted(Path(messages.__file__).parent.rglob("*.py"))
# A file beside the frames that artists do not know, options of the command line, and numbers of errors.
FORBIDDEN = re.compile(r"--|\bpass -|\bpass --|hush\.toml|hush\.json|\[Errno|os error|None\b|==|####\.exr|layers all")


def every_text() -> dict[str, str]:
    return {**messages.TEXTS, **{f"stale {key}": text for key, text in messages.STALE.items()}}


def test_no_words_of_the_command_line() -> None:
    for key, text in every_text().items():
        found = FORBIDDEN.search(text)
        assert not found, f"{key}: {found[0]!r} in {text!r}"


def test_lists_are_sentences() -> None:
    names = ["Denoising Data", "Vector", "Depth"]
    made = [messages.listed(names[:count]) for count in range(4)]
    assert made == ["", "Denoising Data", "Denoising Data and Vector", "Denoising Data, Vector and Depth"]


def test_sentences_begin_with_a_capital_but_for_names() -> None:
    assert messages.sentence("the frames") == "The frames" and messages.sentence("λ has a driver").startswith("λ")
    assert messages.sentence("frame_0001.exr has no view layer") == "frame_0001.exr has no view layer"


def test_fields_are_named() -> None:
    for key, text in every_text().items():
        for _, field, _, conversion in string.Formatter().parse(text):
            assert field is None or field.isidentifier(), f"{key}: {text}"
            assert conversion is None, f"{key}: {text}"


def test_counts_agree() -> None:
    """What is counted has its noun and verb from the count."""
    for key, text in every_text().items():
        plain = re.sub(r"{[^}]*}", "{}", text)
        assert not re.search(r"{} (frames?|problems?|files?|nodes?) ", plain), f"{key}: {text}"
    assert messages.text("unrendered", frames=[3], how="render it") == "Frame 3 is not rendered: render it"
    assert messages.text("unrendered", frames=[9, 3, 4], how="render them") == "Frames 3-4, 9 are not rendered: render them"
    assert messages.text("problems", count=1) == "1 problem" and messages.text("problems", count=2) == "2 problems"
    assert messages.text("status_stale", count=1, reasons="x") == "1 is out of date: x"
    assert messages.text("status_stale", count=2, reasons="x") == "2 are out of date: x"


def test_every_message_is_used_and_there() -> None:
    code = {path: path.read_text(encoding="utf-8") for path in SOURCES if path.name != "texts.py"}
    everything = "\n".join(code.values())
    unused = [key for key in messages.TEXTS if f'"{key}"' not in everything]
    assert unused == [], unused
    for path, text in code.items():
        for key in re.findall(r"""messages\.text\(\s*"(\w+)\"""", text):
            assert key in messages.TEXTS, f"{path.name} asks for {key}"


def test_no_report_has_words_of_its_own() -> None:
    """Nothing is told to artists but from the table."""
    others = {"build.py", "worker.py"}
    own = re.compile(r"""(report\(\{[^}]*\}, |Refusal\(|label\(text=)f?"[A-Za-z{]""")
    for path in SOURCES:
        if path.name not in others:
            found = own.search(path.read_text(encoding="utf-8"))
            assert not found, f"{path.name}: {found[0]}"


def test_refused_frames_have_all_fields() -> None:
    """Their messages are chosen in the process that composites, so that no call names its fields."""
    verdicts = kit.module("compositing.verdicts")
    keys = re.findall(r"""Verdict\((?:""|\w+), "(\w+)\"""", Path(verdicts.__file__).read_text(encoding="utf-8"))
    assert {"unrendered", "composite_old", "stale"} <= set(keys), keys
    for key in keys:
        assert verdicts.in_words({3: (key, "the reason")}, "how"), key


def test_problems_name_a_button_or_a_field() -> None:
    """Where Check Shot finds something, its words say what to do about it."""
    scene, files = (kit.module(name) for name in ("checks.scene", "checks.files"))
    code = "".join(Path(module.__file__).read_text(encoding="utf-8") for module in (scene, files))
    keys = re.findall(r"""problem\(\s*"\w+",\s*"(\w+)\"""", code)
    assert len(keys) > 25, keys
    advice = re.compile(
        r"press |Press |choose |Choose |turn |Turn |set |Set |save the file|open that file|add one|Give one|make room|Install|bake|"
        r"under Output|Vectors From|cannot be denoised|is cut off"
    )
    for key in keys:
        for how in ("how_render", "how_prepare", "how_elsewhere"):
            told = messages.TEXTS[key].replace("{how}", messages.text(how))
            assert advice.search(told), f"{key}: {told}"


def test_reasons_of_the_library() -> None:
    kinds = (
        "lambda, lambda_masked, lambda_pass, lambda_images, lambda_image, window, layers, view, vector_layer, guides, passes, aovs, "
        "keep_noisy, skip, second_pass, model, revision, renderer, several, input_changed, input_missing, input_damaged, neighbours, "
        "output_damaged, output_changed, unfinished, failed, foreign"
    )
    for kind in kinds.split(", "):
        assert messages.stale(kind) == messages.STALE[kind]
    assert messages.stale("failed", "the disk is full (os error 28)") == "the disk is full"
    assert messages.stale("of a newer Hush", "because (os error 28)") == "because"


def test_errors_lose_the_words_of_the_command_line() -> None:
    cases = {
        "frame 12 has no Vector pass: enable it, or set window to 0": "or set Window to This Frame Only",
        "a Vector pass of zeros: render Vector in a second view layer and set vector layer to NAME": "choose it under Vectors From",
        "; the view layer Vectors has one: set vector layer to 'Vectors'": "choose Vectors under Vectors From",
        "no light passes: enable some, or set aovs to none": "or turn Light Passes off",
        "choose another output folder or set overwrite to true to replace what is there": "choose another folder under",
        "set vector layer to 'V', or set overwrite to true": "choose V under Vectors From, or choose another folder under",
        "no folder is known: set output to DIR, or write it into hush.toml": "choose a folder under Denoised Frames",
        "[Errno 2] No such file or directory: '/x'": "No such file or directory: '/x'",
        "/x: No such file or directory (os error 2)": "/x: No such file or directory",
    }
    for error, words in cases.items():
        told = messages.of_error(error)
        assert words in told and not FORBIDDEN.search(told), (error, told)
    assert messages.of_error(FileNotFoundError(2, "No such file or directory", "/x")) == "/x: No such file or directory"
    assert messages.of_error(PermissionError(13, "Permission denied")) == "Permission denied"
    assert messages.of_error(KeyError()) == "KeyError"


def test_every_setting_that_the_library_advises_has_its_field() -> None:
    """Sources of the library, where they are at hand: what they say to set is a button or a field after `of_error`."""
    sources = Path(kit.__file__).resolve().parents[2] / "src"
    skipped = {"cli", "report", "watch"}
    advised = re.compile(r"set (?:window|vector layer|aovs|output|overwrite|enable|layers?|view|guides|model|renderer|memory) to ")
    texts = [
        re.sub(r"\\\s+", "", text)
        for path in sorted(sources.rglob("*.rs"))
        if path.relative_to(sources).parts[0] not in skipped
        for text in re.findall(r'"((?:[^"\\]|\\.)*)"', path.read_text(encoding="utf-8").split("#[cfg(test)]")[0], re.DOTALL)
    ]
    texts = [text for text in texts if advised.search(text)]
    assert len(texts) > 5, texts
    for text in texts:
        told = messages.of_error(text.replace("{layer}", "V").replace("{0}", "V"))
        assert not advised.search(told), (text, told)
