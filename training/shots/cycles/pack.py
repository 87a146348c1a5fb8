"""Packs Blender as a module, its interpreter and all that rendering shots needs, for a machine without either or a network.

    python -m training.shots.cycles.pack runs/pack --assets runs/assets --ptxas /path/to/ptxas

Run it with the interpreter that has bpy. It writes pack.000, pack.001 … of at most --chunk megabytes, pack.sha256 and unpack.sh. There:

    sh unpack.sh FOLDER && FOLDER/render OUT --device cuda --processes 14 --first 60000 --count 500

FOLDER/benchmark does the same for the benchmark's shots. What only interfaces, AMD's and Intel's GPUs and Cycles' own denoising want is
left out; a C compiler makes empty libraries in the places of two. --ptxas translates Cycles' CUDA kernel for a GPU architecture that the
package has none for, which takes minutes here instead of in every process there; the kernel stays beside the pieces for the next pack, and
need not travel with them.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import io
import lzma
import re
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]
PACKAGES = ("bpy", "numpy", "numpy.libs", "OpenEXR*", "Imath.py")
# What Blender's own add-ons import when it starts.
PACKAGES += ("attr", "attrs", "cattr", "cattrs", "typing_extensions.py", "requests", "urllib3", "idna", "certifi", "charset_normalizer")
# Of bpy and of the interpreter, by the path below them.
LEFT_OUT = re.compile(
    r"__pycache__|\.pyc$|/lib/kernel_(gfx|rt_gfx|oneapi)|/lib/libOpenImageDenoise_device|/lib/libur_adapter|/hiprt.*\.zst$"
    r"|^bpy/\d\.\d+/(assets|python)/|^bpy/\d\.\d+/datafiles/(assets|fonts|locale|studiolights|icons)/|/scripts/(templates|presets)"
    r"|^lib/python3\.\d+/(test|idlelib|tkinter|turtledemo|ensurepip|lib2to3|site-packages|config-[^/]*)/"
)
# Large, wanted when bpy is loaded and never called here: a library with the same names and nothing behind them goes in its place. (OIDN's
# core is called: Cycles asks it about every CUDA device.)
HOLLOW = re.compile(r"/lib/libcycles_kernel_oneapi_aot\.so")
OTHER_KERNELS = re.compile(r"/lib/kernel_sm_\d+\.cubin")
# These come with every Linux, and another machine's own are the right ones.
SYSTEM = re.compile(r"^(linux-vdso|ld-linux|lib(c|m|dl|rt|util|pthread|resolv|nsl|stdc\+\+|gcc_s)\.so)")
START = """#!/bin/sh
here=$(cd "$(dirname "$0")" && pwd)
export LD_LIBRARY_PATH="$here/python/lib:$here/libraries${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}" PYTHONPATH="$here/packages:$here/code"
unset PYTHONHOME
exec "$here/python/bin/python" -m MODULE "$@"
"""
UNPACK = """#!/bin/sh
set -e
from=$(cd "$(dirname "$0")" && pwd)
mkdir -p "${1:?usage: unpack.sh FOLDER}"
(cd "$from" && sha256sum -c --quiet pack.sha256)
cat "$from"/pack.[0-9][0-9][0-9] | tar -xJ -C "$1"
"""


class Chunks(io.RawIOBase):
    """A file for writing that is cut into pieces of at most `size` bytes: pack.000, pack.001 …"""

    def __init__(self, folder: Path, size: int) -> None:
        super().__init__()
        self.folder, self.size = folder, size
        self.sums: list[tuple[str, str]] = []
        self._piece, self._hash = bytearray(), hashlib.sha256()

    def writable(self) -> bool:
        return True

    def write(self, data: bytes) -> int:  # type: ignore[override]
        self._piece += data
        while len(self._piece) >= self.size:
            self._put(bytes(self._piece[: self.size]))
            del self._piece[: self.size]
        return len(data)

    def close(self) -> None:
        """Writes what is left, and the checksums."""
        if not self.closed:
            if self._piece:
                self._put(bytes(self._piece))
                self._piece.clear()
            (self.folder / "pack.sha256").write_text("".join(f"{checksum}  {name}\n" for name, checksum in self.sums))
        super().close()

    def _put(self, piece: bytes) -> None:
        name = f"pack.{len(self.sums):03d}"
        (self.folder / name).write_bytes(piece)
        self.sums.append((name, hashlib.sha256(piece).hexdigest()))


def files(folder: Path, below: str = "") -> Iterator[tuple[Path, str]]:
    """The files below a folder that are not left out, with their names there; `below` goes before these."""
    for path in sorted(folder.rglob("*")):
        name = below + str(path.relative_to(folder))
        if path.is_file() and not LEFT_OUT.search(name):
            yield path, name


def libraries(binaries: list[Path]) -> dict[str, Path]:
    """The shared libraries of the system that these want and another machine may lack."""
    found = {}
    for binary in binaries:
        said = subprocess.run(["ldd", str(binary)], capture_output=True, text=True, check=True).stdout
        for name, where in re.findall(r"(\S+) => (/\S+)", said):
            if not SYSTEM.match(name) and "site-packages" not in where:
                found[name] = Path(where)
    return found


def hollow(library: Path, folder: Path) -> Path:
    """A library with the names of another."""
    said = subprocess.run(["nm", "-D", "--defined-only", str(library)], capture_output=True, text=True, check=True).stdout
    names = {line.split()[-1].split("@")[0] for line in said.splitlines()}
    made = folder / library.name
    command = ["cc", "-shared", "-nostdlib", "-w", f"-Wl,-soname,{library.name}", "-x", "c", "-", "-o", str(made)]
    source = "".join(f"void *{name}[16];\n" for name in sorted(names) if re.fullmatch(r"[A-Za-z_]\w*", name))
    subprocess.run(command, input=source, text=True, check=True)
    return made


def cubin(kernels: Path, architecture: int, ptxas: Path, target: Path) -> None:
    """Writes Cycles' CUDA kernel for an architecture, from the intermediate one of the package, compressed as Cycles reads it."""
    import zstandard

    source = max(kernels.glob("kernel_compute_*.ptx.zst"))
    with tempfile.TemporaryDirectory() as scratch:
        ptx, made = Path(scratch) / "kernel.ptx", Path(scratch) / "kernel.cubin"
        with source.open("rb") as packed, ptx.open("wb") as plain:
            zstandard.ZstdDecompressor().copy_stream(packed, plain)
        subprocess.run([str(ptxas), f"-arch=sm_{architecture}", "-o", str(made), str(ptx)], check=True)
        target.write_bytes(zstandard.ZstdCompressor(10).compress(made.read_bytes()))


def contents(bpy: Path, assets: Path | None) -> Iterator[tuple[Path, str]]:
    """Each file with its name in the pack."""
    base, site = Path(sys.base_prefix), bpy.parent
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    yield base / "bin" / version, "python/bin/python"
    for path, name in files(base / "lib" / version, f"lib/{version}/"):
        yield path, f"python/{name}"
    for path in base.glob("lib/libpython3.*.so.*"):
        yield path, f"python/lib/{path.name}"
    for package in PACKAGES:
        for path in site.glob(package):
            for file, name in [(path, path.name)] if path.is_file() else files(path, f"{path.name}/"):
                yield file, f"packages/{name}"
    binaries = [base / "bin" / version, *site.glob("OpenEXR*.so"), bpy / "__init__.so"]
    for name, path in libraries(binaries).items():
        if not name.startswith("libpython3."):
            yield path, f"libraries/{name}"
    for folder in ("training", "samples"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            yield path, f"code/{path.relative_to(ROOT)}"
    for path in sorted(assets.iterdir()) if assets else ():
        yield path, f"assets/{path.name}"


def script(text: str) -> tuple[tarfile.TarInfo, io.BytesIO]:
    about = tarfile.TarInfo()
    about.size, about.mode = len(text.encode()), 0o755
    return about, io.BytesIO(text.encode())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=Path, help="folder for the pieces")
    parser.add_argument("--assets", type=Path, help="folder of training.shots.cycles.fetch_assets, to go along")
    parser.add_argument("--chunk", type=int, default=60, help="megabytes of a piece at most")
    parser.add_argument("--ptxas", type=Path, help="NVIDIA's assembler, from the packages triton or nvidia-cuda-nvcc")
    parser.add_argument("--architecture", type=int, default=90, help="compute capability to translate the CUDA kernel for, with --ptxas")
    chosen = parser.parse_args()
    found = importlib.util.find_spec("bpy")
    if found is None or not found.origin:
        sys.exit("no bpy here: run it with the interpreter that has it")
    bpy = Path(found.origin).parent
    chosen.output.mkdir(parents=True, exist_ok=True)
    for old in chosen.output.glob("pack.*"):
        old.unlink()
    pieces = Chunks(chosen.output, chosen.chunk * 1_000_000)
    kernels = next(bpy.glob("*/scripts/addons_core/cycles/lib"))
    kernel = chosen.output / f"kernel-{kernels.relative_to(bpy).parts[0]}-sm_{chosen.architecture}.cubin.zst"
    if chosen.ptxas and not kernel.exists():
        cubin(kernels, chosen.architecture, chosen.ptxas, kernel)
    with (
        tempfile.TemporaryDirectory() as scratch,
        pieces,
        lzma.open(pieces, "wb", preset=2) as squeezed,
        tarfile.open(fileobj=squeezed, mode="w|") as pack,
    ):
        for path, name in contents(bpy, chosen.assets):
            if chosen.ptxas and OTHER_KERNELS.search(name):
                continue
            kept = hollow(path, Path(scratch)) if HOLLOW.search(name) else path.resolve()
            pack.add(kept, name, recursive=False)
        if chosen.ptxas:
            pack.add(kernel, f"packages/{kernels.relative_to(bpy.parent)}/kernel_sm_{chosen.architecture}.cubin.zst")
        for name, module in (("render", "training.shots.cycles.render"), ("benchmark", "training.benchmark.render")):
            about, text = script(START.replace("MODULE", module))
            about.name = name
            pack.addfile(about, text)
    unpack = chosen.output / "unpack.sh"
    unpack.write_text(UNPACK)
    unpack.chmod(0o755)
    print(f"{len(pieces.sums)} pieces in {chosen.output}")


if __name__ == "__main__":
    main()
