"""Compiles apply.cu at run time and starts it: with NVRTC, which comes with PyTorch, and the driver. No CUDA toolkit is needed."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cache
from pathlib import Path

import torch
from torch import Tensor

SOURCES = [Path(__file__).with_name(name) for name in ("tap.h", "apply.cu")]
THREADS = 128


def source() -> str:
    return "\n".join(path.read_text() for path in SOURCES).replace("#pragma once", "")


def nvrtc() -> ctypes.CDLL:
    """NVRTC, of PyTorch's CUDA."""
    torch.cuda.is_available()  # loads the libraries of the wheels
    version = str(torch.version.cuda).split(".")[0]
    folders = [Path(torch.__file__).parents[1] / "nvidia" / part / "lib" for part in (f"cu{version}", "cuda_nvrtc")]
    for name in (f"libnvrtc.so.{version}", *(f"{folder}/libnvrtc.so.{version}" for folder in folders), "libnvrtc.so"):
        try:
            return ctypes.CDLL(name)
        except OSError:
            continue
    raise RuntimeError(f"libnvrtc.so.{version} is not where PyTorch's CUDA is: train without --fused")


def compiled(architecture: str) -> bytes:
    """The machine code for an architecture, such as sm_90; needs no GPU."""
    library, program, size = nvrtc(), ctypes.c_void_p(), ctypes.c_size_t()
    library.nvrtcCreateProgram(ctypes.byref(program), source().encode(), b"apply.cu", 0, None, None)
    options = [f"--gpu-architecture={architecture}".encode(), b"--use_fast_math", b"--std=c++17"]
    failed = library.nvrtcCompileProgram(program, len(options), (ctypes.c_char_p * len(options))(*options))
    if failed:
        library.nvrtcGetProgramLogSize(program, ctypes.byref(size))
        log = ctypes.create_string_buffer(size.value)
        library.nvrtcGetProgramLog(program, log)
        raise RuntimeError(f"cannot build {SOURCES[-1].name} for {architecture}:\n{log.value.decode()}")
    library.nvrtcGetCUBINSize(program, ctypes.byref(size))
    code = ctypes.create_string_buffer(size.value)
    library.nvrtcGetCUBIN(program, code)
    library.nvrtcDestroyProgram(ctypes.byref(program))
    return code.raw


@cache
def driver() -> ctypes.CDLL:
    return ctypes.CDLL("libcuda.so.1")


def checked(result: int) -> None:
    if result:
        message = ctypes.c_char_p()
        driver().cuGetErrorString(result, ctypes.byref(message))
        raise RuntimeError(f"CUDA: {(message.value or b'unknown error').decode()}")


@cache
def functions(device: int) -> dict[str, ctypes.c_void_p]:
    """The compiled functions, loaded on a device that PyTorch has made current."""
    major, minor = torch.cuda.get_device_capability(device)
    module = ctypes.c_void_p()
    checked(driver().cuModuleLoadData(ctypes.byref(module), compiled(f"sm_{major}{minor}")))
    found = {name: ctypes.c_void_p() for name in ("hush_apply", "hush_apply_backward")}
    for name, function in found.items():
        checked(driver().cuModuleGetFunction(ctypes.byref(function), module, name.encode()))
    return found


@cache
def on_device(sizes: tuple[int, ...], device: torch.device) -> Tensor:
    return torch.tensor(sizes, dtype=torch.int32, device=device)


def launch(name: str, sizes: Sequence[int], coarse_taps: int, images: Tensor, *arrays: Tensor) -> None:
    """One function over all pixels, in PyTorch's current stream; images (B, T, 3, H, W) gives the shape, empty arrays become null."""
    b, t, _, h, w = images.shape
    for a in arrays:
        assert a.is_contiguous() and a.dtype == torch.float32
    widths = on_device(tuple(sizes), images.device)
    values = [ctypes.c_int(n) for n in (b, t, h, w, coarse_taps)]
    values += [ctypes.c_void_p(a.data_ptr() if a.numel() else None) for a in (widths, *arrays)]
    pointers = (ctypes.c_void_p * len(values))(*(ctypes.cast(ctypes.pointer(v), ctypes.c_void_p) for v in values))
    with torch.cuda.device(images.device):
        stream = ctypes.c_void_p(torch.cuda.current_stream().cuda_stream)
        function, blocks = functions(images.device.index)[name], -(-b * h * w // THREADS)
        checked(driver().cuLaunchKernel(function, blocks, 1, 1, THREADS, 1, 1, 0, stream, pointers, None))
