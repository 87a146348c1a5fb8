"""Kernel application for training on the CPU, in C++ (fused.cpp): the same function as the taps in PyTorch, in a tenth of the time.

Compiled with g++ on first use, beside the source, for this machine's processor.
"""

from __future__ import annotations

import ctypes
import os
import subprocess
from functools import cache
from pathlib import Path

import torch
from torch import Tensor

SOURCE = Path(__file__).with_suffix(".cpp")


@cache
def library() -> ctypes.CDLL:
    """The compiled library; SystemExit that names the compiler's message where it cannot be built."""
    built = Path(os.environ.get("HUSH_FUSED", SOURCE.with_name("fused_native.so")))
    if not built.exists() or built.stat().st_mtime < SOURCE.stat().st_mtime:
        aside = built.with_suffix(f".{os.getpid()}")
        compiled = aside.with_suffix(".o")
        # Two steps: linking with -ffast-math would switch denormals off for the whole process.
        for command in (["-O3", "-march=native", "-ffast-math", "-fPIC", "-c", SOURCE, "-o", compiled], ["-shared", compiled, "-o", aside]):
            done = subprocess.run(["g++", *map(str, command)], capture_output=True, text=True, check=False)
            if done.returncode != 0:
                raise SystemExit(f"cannot build {SOURCE.name}, train without --fused:\n{done.stderr}")
        compiled.unlink()
        os.replace(aside, built)
    return ctypes.CDLL(str(built))


def call(name: str, sizes: tuple[int, ...], coarse_taps: int, images: Tensor, *arrays: Tensor | None) -> None:
    """One function of the library; images (B, T, 3, H, W) gives the shape, `arrays` follow in the function's order, None as null."""
    b, t, _, h, w = images.shape
    for a in arrays:
        assert a is None or (a.is_contiguous() and a.dtype == torch.float32)
    shape = [ctypes.c_ssize_t(n) for n in (b, t, h, w)]
    pointers = [ctypes.c_void_p(None if a is None else a.data_ptr()) for a in arrays]
    getattr(library(), name)(*shape, (ctypes.c_int * t)(*sizes), ctypes.c_int(coarse_taps), *pointers)


class Apply(torch.autograd.Function):
    """One softmax over all taps and its weighted average; gradients for the logits and the coarser level's colours."""

    @staticmethod
    def forward(
        ctx: torch.autograd.function.FunctionCtx,
        logits: Tensor,
        images: Tensor,
        valid: Tensor,
        colour: Tensor | None,
        mask: Tensor | None,
        queries: Tensor | None,
        keys: Tensor | None,
        sizes: tuple[int, ...],
        coarse_taps: int,
    ) -> tuple[Tensor, Tensor]:
        plain = lambda x: None if x is None else x.float().contiguous()
        logits, images, valid, queries, keys = (plain(x) for x in (logits, images, valid, queries, keys))
        coarse = torch.zeros(0) if colour is None else torch.cat((colour, mask), 1).float().contiguous()
        out, norm = torch.zeros_like(images[:, 0]).contiguous(), torch.zeros_like(valid[:, 0]).contiguous()
        call("hush_apply", sizes, coarse_taps, images, logits, images, valid, coarse, queries, keys, out, norm)
        ctx.save_for_backward(logits, images, valid, coarse, queries, keys, out, norm)
        ctx.sizes, ctx.coarse_taps = sizes, coarse_taps
        ctx.mark_non_differentiable(norm)
        return out, norm

    @staticmethod
    def backward(ctx: torch.autograd.function.FunctionCtx, *gradients: Tensor) -> tuple[Tensor | None, ...]:
        logits, images, valid, coarse, queries, keys, out, norm = ctx.saved_tensors
        to_logits = torch.zeros_like(logits)
        to_coarse = torch.zeros_like(coarse[:, :3]).contiguous() if ctx.coarse_taps else torch.zeros(0)
        to_queries = None if queries is None else torch.zeros_like(queries)
        pull = gradients[0].float().contiguous()
        arrays = (logits, images, valid, coarse, queries, keys, out, norm, pull, to_logits, to_coarse, to_queries)
        call("hush_apply_backward", ctx.sizes, ctx.coarse_taps, images, *arrays)
        return to_logits, None, None, to_coarse if ctx.coarse_taps else None, None, to_queries, None, None, None


def average(
    logits: Tensor,
    images: Tensor,
    valid: Tensor,
    sizes: tuple[int, ...],
    coarse: tuple[Tensor, Tensor] | None = None,
    coarse_taps: int = 0,
    keyed: tuple[Tensor, Tensor] | None = None,
) -> tuple[Tensor, Tensor]:
    """As `model.kernel_average`."""
    colour, mask = coarse or (None, None)
    queries, keys = keyed or (None, None)
    return Apply.apply(logits, images, valid, colour, mask, queries, keys, sizes, coarse_taps if coarse else 0)
