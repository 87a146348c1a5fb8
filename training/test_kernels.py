"""Kernel application in PyTorch, in C++ and in CUDA is one function: python -m pytest training"""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
import torch
from torch import Tensor

from training.example_shots import noise
from training.network import cuda, fused
from training.network.model import kernel_average

ROWS, COLUMNS = 24, 40
# What a CPU lacks of CUDA; a thread after another.
SHIM = """
#include <cmath>
#define __global__
#define __device__
static struct { long long x; } blockIdx, threadIdx, blockDim = {1};
static void atomicAdd(float *to, float value) { *to += value; }
"""
LOOP = """
extern "C" void shim_%s(long long pixels%s) { for (blockIdx.x = 0; blockIdx.x < pixels; ++blockIdx.x) %s(%s); }
"""


def looped(name: str, pointers: int) -> str:
    kinds = ["int"] * 5 + ["const int *"] + ["float *"] * pointers
    return LOOP % (name, "".join(f", {kind} a{k}" for k, kind in enumerate(kinds)), name, ", ".join(f"a{k}" for k in range(len(kinds))))


@pytest.fixture(scope="module")
def shim(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., None]:
    """`cuda.launch` on a CPU: apply.cu as C++."""
    folder = tmp_path_factory.mktemp("shim")
    loops = looped("hush_apply", 9) + looped("hush_apply_backward", 14)
    (folder / "shim.cpp").write_text(SHIM + cuda.source() + loops)
    subprocess.run(["g++", "-O2", "-std=c++17", "-shared", "-fPIC", str(folder / "shim.cpp"), "-o", str(folder / "shim.so")], check=True)
    library = ctypes.CDLL(str(folder / "shim.so"))

    def launch(name: str, sizes: Sequence[int], coarse_taps: int, images: Tensor, *arrays: Tensor) -> None:
        b, t, _, h, w = images.shape
        pointers = [ctypes.c_void_p(a.data_ptr() if a.numel() else None) for a in arrays]
        shape = [ctypes.c_int(n) for n in (b, t, h, w, coarse_taps)]
        getattr(library, f"shim_{name}")(ctypes.c_longlong(b * h * w), *shape, (ctypes.c_int * t)(*sizes), *pointers)

    return launch


@pytest.mark.parametrize("keyed", [True, False])
@pytest.mark.parametrize(("sizes", "coarse"), [((5, 3, 3), 3), ((5,), 3), ((5, 3), 0), ((3, 1, 1, 1), 0), ((3, 1, 5), 5)])
def test_the_three_ways_to_apply_kernels_are_one(
    sizes: tuple[int, ...], coarse: int, keyed: bool, shim: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    taps = sum(s * s for s in sizes) + coarse**2
    logits = noise(2, taps, ROWS, COLUMNS, seed=1) * 90 - 45
    images, valid = noise(2, len(sizes), 3, ROWS, COLUMNS, seed=2) * 9, (noise(2, len(sizes), 1, ROWS, COLUMNS, seed=3) > 0.3).float()
    colour, mask = noise(2, 3, ROWS // 2, COLUMNS // 2, seed=4), (noise(2, 1, ROWS // 2, COLUMNS // 2, seed=5) > 0.2).float()
    pull = noise(2, 3, ROWS, COLUMNS, seed=6)
    queries, keys = noise(2, len(sizes), 2, ROWS, COLUMNS, seed=7) * 8 - 4, noise(2, len(sizes), 1, ROWS, COLUMNS, seed=8)

    def results(average: Callable[..., tuple[Tensor, Tensor]]) -> list[Tensor]:
        inputs = [x.clone().requires_grad_() for x in (logits, images, *((colour,) if coarse else ()), *((queries,) if keyed else ()))]
        level = (inputs[2], mask) if coarse else None
        out, norm = average(inputs[0], inputs[1], valid, sizes, level, coarse, (inputs[-1], keys) if keyed else None)
        (out * pull).sum().backward()
        return [out.detach(), norm.detach().log1p(), *(x.grad for x in inputs)]

    plain, in_cpp = results(kernel_average), results(fused.average)
    monkeypatch.setattr(fused, "launch", shim)
    in_cuda = results(fused.average)
    for one, *others in zip(plain, in_cpp, in_cuda, strict=True):
        assert one.abs().max() > 0
        for other in others:
            torch.testing.assert_close(other, one, rtol=1e-4, atol=1e-5)


def test_images_that_are_data_cost_no_gradient() -> None:
    logits, images = noise(1, 9, 8, 8, seed=1).requires_grad_(), noise(1, 1, 3, 8, 8, seed=2)
    fused.average(logits, images, torch.ones(1, 1, 1, 8, 8), (3,))[0].sum().backward()
    assert logits.grad is not None and images.grad is None


def test_the_gpu_source_compiles_where_pytorch_has_nvrtc() -> None:
    if torch.version.cuda is None:
        pytest.skip("PyTorch without CUDA")
    assert cuda.compiled("sm_90")[:4] == b"\x7fELF"


def test_an_error_in_the_gpu_source_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    if torch.version.cuda is None:
        pytest.skip("PyTorch without CUDA")
    (tmp_path / "apply.cu").write_text("nonsense;")
    monkeypatch.setattr(cuda, "SOURCES", [tmp_path / "apply.cu"])
    with pytest.raises(RuntimeError, match="nonsense"):
        cuda.compiled("sm_90")


def test_the_operator_can_be_compiled_into_a_graph() -> None:
    logits, images = noise(1, 9, 8, 8, seed=1).requires_grad_(), noise(1, 1, 3, 8, 8, seed=2)
    none = images.new_zeros(0)
    torch.library.opcheck(fused.apply, (logits, images, torch.ones(1, 1, 1, 8, 8), none, none, none, none, [3], 0))
