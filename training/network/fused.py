"""Kernel application for training, as one function with its gradient: in C++ on a CPU (fused.cpp), in CUDA on a GPU (apply.cu).

The same function as the taps in PyTorch (`model.kernel_average`), in a tenth of the time. Both are compiled on first use, for this
machine: the C++ with g++, beside the source.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import torch
from torch import Tensor

from training.network import cuda
from training.network.model import kernel_average

SOURCE = Path(__file__).with_suffix(".cpp")
HEADER = SOURCE.with_name("tap.h")


@cache
def library() -> ctypes.CDLL:
    """The compiled library; SystemExit that names the compiler's message where it cannot be built."""
    built = Path(os.environ.get("HUSH_FUSED", SOURCE.with_name("fused_native.so")))
    if not built.exists() or built.stat().st_mtime < max(SOURCE.stat().st_mtime, HEADER.stat().st_mtime):
        aside = built.with_suffix(f".{os.getpid()}")
        compiled = built.with_suffix(f".{os.getpid()}.o")
        # Two steps: linking with -ffast-math would switch denormals off for the whole process.
        for command in (["-O3", "-march=native", "-ffast-math", "-fPIC", "-c", SOURCE, "-o", compiled], ["-shared", compiled, "-o", aside]):
            done = subprocess.run(["g++", *map(str, command)], capture_output=True, text=True, check=False)
            if done.returncode != 0:
                raise SystemExit(f"cannot build {SOURCE.name}, train without --fused:\n{done.stderr}")
        compiled.unlink()
        os.replace(aside, built)
    return ctypes.CDLL(str(built))


def launch(name: str, sizes: Sequence[int], coarse_taps: int, images: Tensor, *arrays: Tensor) -> None:
    """One function of the library, as `cuda.launch`."""
    b, t, _, h, w = images.shape
    for a in arrays:
        assert a.is_contiguous() and a.dtype == torch.float32
    shape = [ctypes.c_ssize_t(n) for n in (b, t, h, w)]
    pointers = [ctypes.c_void_p(a.data_ptr() if a.numel() else None) for a in arrays]
    getattr(library(), name)(*shape, (ctypes.c_int * t)(*sizes), ctypes.c_int(coarse_taps), *pointers)


def plain(*tensors: Tensor) -> list[Tensor]:
    return [x.float().contiguous() for x in tensors]


@torch.library.custom_op("hush::kernel_average", mutates_args=())
def apply(
    logits: Tensor, images: Tensor, valid: Tensor, colour: Tensor, mask: Tensor, queries: Tensor, keys: Tensor,
    sizes: list[int], coarse_taps: int,
) -> tuple[Tensor, Tensor]:  # fmt: skip
    """`model.kernel_average` with empty tensors for what is not there: the average and the sum of the weights."""
    arrays = plain(logits, images, valid, colour, mask, queries, keys)
    results = [torch.zeros_like(arrays[1][:, 0]), torch.zeros_like(arrays[2][:, 0])]
    (cuda.launch if images.is_cuda else launch)("hush_apply", sizes, coarse_taps, images, *arrays, *results)
    return results[0], results[1]


@torch.library.custom_op("hush::kernel_average_backward", mutates_args=())
def apply_backward(
    logits: Tensor, images: Tensor, valid: Tensor, colour: Tensor, mask: Tensor, queries: Tensor, keys: Tensor, out: Tensor, norm: Tensor,
    gradient: Tensor, sizes: list[int], coarse_taps: int, for_images: bool,
) -> tuple[Tensor, Tensor, Tensor, Tensor]:  # fmt: skip
    """Gradients for the logits, the images (empty if not `for_images`), the coarser level's colours and the queries."""
    arrays = plain(logits, images, valid, colour, mask, queries, keys, out, norm, gradient)
    results = [torch.zeros_like(arrays[k], memory_format=torch.contiguous_format) for k in (0, 1, 3, 5)]
    if not for_images:
        results[1] = images.new_zeros(0, dtype=torch.float32)
    (cuda.launch if images.is_cuda else launch)("hush_apply_backward", sizes, coarse_taps, images, *arrays, *results)
    return results[0], results[1], results[2], results[3]


@apply.register_fake
def _(
    logits: Tensor, images: Tensor, valid: Tensor, colour: Tensor, mask: Tensor, queries: Tensor, keys: Tensor,
    sizes: list[int], coarse_taps: int,
) -> tuple[Tensor, Tensor]:  # fmt: skip
    b, _, _, h, w = images.shape
    empty = lambda channels: images.new_empty(b, channels, h, w, dtype=torch.float32)
    return empty(3), empty(1)


@apply_backward.register_fake
def _(
    logits: Tensor, images: Tensor, valid: Tensor, colour: Tensor, mask: Tensor, queries: Tensor, keys: Tensor, out: Tensor, norm: Tensor,
    gradient: Tensor, sizes: list[int], coarse_taps: int, for_images: bool,
) -> tuple[Tensor, Tensor, Tensor, Tensor]:  # fmt: skip
    empty = lambda of: of.new_empty(of.shape, dtype=torch.float32)
    return empty(logits), empty(images) if for_images else images.new_empty(0, dtype=torch.float32), empty(colour), empty(queries)


def remember(ctx: torch.autograd.function.FunctionCtx, inputs: tuple[object, ...], output: tuple[Tensor, Tensor]) -> None:
    *tensors, sizes, coarse_taps = inputs
    ctx.save_for_backward(*tensors, *output)
    ctx.sizes, ctx.coarse_taps = sizes, coarse_taps


def backward(ctx: torch.autograd.function.FunctionCtx, gradient: Tensor, _: Tensor) -> tuple[Tensor | None, ...]:
    """Valid pixels, masks and keys are data: they have no gradient, and neither has anything by way of the sum of the weights."""
    to = apply_backward(*ctx.saved_tensors, gradient, ctx.sizes, ctx.coarse_taps, ctx.needs_input_grad[1])
    to_images = to[1] if ctx.needs_input_grad[1] else None
    return to[0], to_images, None, to[2], None, to[3], None, None, None


apply.register_autograd(backward, setup_context=remember)


def average(
    logits: Tensor,
    images: Tensor,
    valid: Tensor,
    sizes: tuple[int, ...],
    coarse: tuple[Tensor, Tensor] | None = None,
    coarse_taps: int = 0,
    keyed: tuple[Tensor, Tensor] | None = None,
) -> tuple[Tensor, Tensor]:
    """As `model.kernel_average`, which it is on devices that have none of the two."""
    if images.device.type not in ("cpu", "cuda"):
        return kernel_average(logits, images, valid, sizes, coarse, coarse_taps, keyed)
    none = images.new_zeros(0)
    colour, mask = coarse or (none, none)
    queries, keys = keyed or (none, none)
    return apply(logits, images, valid, colour, mask, queries, keys, list(sizes), coarse_taps if coarse else 0)
