"""The benchmark's cache: references from passes, their halves, and what is left out; no Blender, no PyTorch, no OIDN."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

sys.path.append(str(ROOT))

from training.benchmark import frames  # noqa: E402
from training.benchmark.frames import Take, beauty, frame, numbers, write_beauty  # noqa: E402


def write(folder: Path, number: int, value: float) -> None:
    write_beauty(frame(folder, number), np.full((2, 3, 3), value, np.float32))


def shot(cache: Path, name: str, passes: dict[int, list[int]], spp: dict[int, list[int]]) -> None:
    """Frames by pass and by samples; pass k has the value 2^k."""
    for k, there in passes.items():
        for n in there:
            write(cache / name / f"pass{k}", n, 2.0**k)
    for samples, there in spp.items():
        for n in there:
            write(cache / name / f"{samples}spp", n, 1.0)


def value(path: Path) -> float:
    return float(beauty(path)[0, 0, 0])


def test_halves_share_no_pass_and_make_up_the_reference(tmp_path: Path) -> None:
    shot(tmp_path, "interior", {1: [1, 2], 2: [1, 2], 3: [1], 4: [1], 10: [1]}, {4: [1, 2]})
    take = frames.takes(tmp_path, ["interior"], [4])[0]
    a, b = take.halves
    assert value(frame(a, 1)) == pytest.approx((2 + 8 + 1024) / 3) and value(frame(b, 1)) == (4 + 16) / 2
    assert (value(frame(a, 2)), value(frame(b, 2)), value(frame(take.reference, 2))) == (2, 4, 3)
    assert value(frame(take.reference, 1)) == pytest.approx((2 + 4 + 8 + 16 + 1024) / 5)


def test_one_pass_has_no_halves(tmp_path: Path) -> None:
    shot(tmp_path, "interior", {1: [1, 2], 2: [2]}, {4: [1, 2]})
    take = frames.takes(tmp_path, ["interior"], [4])[0]
    assert numbers(take.reference) == [1, 2] and [numbers(half) for half in take.halves] == [[2], [2]]
    assert take.passes_a_frame == "1 to 2", "the report says where frames have fewer"


def test_a_new_pass_is_taken_in(tmp_path: Path) -> None:
    shot(tmp_path, "interior", {1: [1], 2: [1]}, {4: [1]})
    take = frames.takes(tmp_path, ["interior"], [4])[0]
    shot(tmp_path, "interior", {3: [1]}, {})
    later = frame(take.reference, 1).stat().st_mtime + 5
    os.utime(frame(tmp_path / "interior" / "pass3", 1), (later, later))
    frames.takes(tmp_path, ["interior"], [4])
    assert value(frame(take.halves[0], 1)) == (2 + 8) / 2 and take.passes_a_frame == "3"


def test_references_of_another_cache_take_the_place_of_its_own(tmp_path: Path) -> None:
    own, other = tmp_path / "own", tmp_path / "other"
    shot(other, "interior", {5: [1], 6: [1]}, {})
    for k in (5, 6):
        os.utime(frame(other / "interior" / f"pass{k}", 1), (1, 1))
    shot(own, "interior", {1: [1], 2: [1]}, {4: [1]})
    take = frames.takes(own, ["interior"], [4])[0]
    assert value(frame(take.reference, 1)) == 3
    frames.takes(own, ["interior"], [4], other)
    assert [value(frame(folder, 1)) for folder in (take.reference, *take.halves)] == [48, 32, 64]
    frames.takes(own, ["interior"], [4])
    assert value(frame(take.reference, 1)) == 3
    written = frame(take.reference, 1).stat()
    frames.takes(own, ["interior"], [4])
    assert frame(take.reference, 1).stat().st_ino == written.st_ino, "what is there is not written again"


def test_a_shot_that_is_not_rendered_is_left_out_and_said_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shot(tmp_path, "interior", {1: [1, 2]}, {4: [1, 2], 32: [1]})
    found = frames.takes(tmp_path, ["interior", "fog", "fur"], [4, 32])
    assert [(take.shot, take.spp) for take in found] == [("interior", 4)]
    said = capsys.readouterr().out
    assert "interior at 32 spp left out: no noisy frame 2" in said
    assert all(f"{name} at {spp} spp left out: no reference" in said for name in ("fog", "fur") for spp in (4, 32))
    assert frames.SHOTS[:4] == frames.FIRST_SHOTS and {"fog", "fur"} <= set(frames.SHOTS)


def test_the_most_samples_that_have_every_frame(tmp_path: Path) -> None:
    shot(tmp_path, "glass", {1: [1, 2]}, {4: [1, 2], 32: [1, 2, 3], 128: [1]})
    (tmp_path / "glass" / "4spp-oidn_high-2.5.1").mkdir()
    take = frames.takes(tmp_path, ["glass"], [4])[0]
    assert frames.levels(tmp_path, "glass") == [4, 32, 128]
    assert take.most_samples.spp == 32
    shot(tmp_path, "fog", {}, {4: [1], 128: [1]})
    assert frames.shared_levels(tmp_path, ["glass", "fog"]) == [4, 128]


def test_the_peers_frames_are_kept_by_version(tmp_path: Path) -> None:
    take = Take(tmp_path, "fur", 4)
    assert take.peer("oidn_clean_aux", "2.5.1") != take.peer("oidn_clean_aux", "3.0.0")
