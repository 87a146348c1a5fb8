"""Builds the wheels that a release has, one a platform, each for every Python from 3.11 on (abi3).

    python release/build_wheel.py manylinux_2_28_x86_64 win_amd64     # into target/wheels
    python release/build_wheel.py --list

Wants maturin and ziglang from PyPI beside this Python, and Rust with the platform's target (`rustup target add`). On Linux Debian's
rustc-web does as well, whose rust-web-src makes the Windows target. Linux wheels are linked by zig against glibc 2.28, which Blender
itself asks for. macOS wheels are built on macOS.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
GLIBC = "manylinux_2_28"
MACOS = "11.0"
DEBIAN = Path("/usr/bin")
# The standard library is built along where there is only its source.
FROM_SOURCE = {"RUSTC_BOOTSTRAP": "1", "CARGO_UNSTABLE_BUILD_STD": "std,panic_unwind,panic_abort"}


class WheelError(Exception):
    """What keeps a wheel from being built, in words."""


@dataclass(frozen=True)
class Platform:
    """A platform of a release: the tag of its wheel, Rust's name of it, and Rust's name of it on a machine that is another."""

    tag: str
    target: str
    cross_target: str | None = None

    @property
    def system(self) -> str:
        """As `sys.platform` has it."""
        return {"manylinux": "linux", "win": "win32", "macosx": "darwin"}[self.tag.split("_")[0]]

    def rust_target(self) -> str:
        """What to build here.

        Raises:
            WheelError: It cannot be built on this system.
        """
        if self.system == sys.platform:
            return self.target
        if self.cross_target is None or sys.platform != "linux":
            raise WheelError(f"{self.tag} is not built on {sys.platform}")
        return self.cross_target


PLATFORMS = {
    platform.tag: platform
    for platform in (
        Platform("manylinux_2_28_x86_64", "x86_64-unknown-linux-gnu"),
        Platform("manylinux_2_28_aarch64", "aarch64-unknown-linux-gnu"),
        Platform("win_amd64", "x86_64-pc-windows-msvc", "x86_64-pc-windows-gnu"),
        Platform("macosx_11_0_arm64", "aarch64-apple-darwin"),
        Platform("macosx_11_0_x86_64", "x86_64-apple-darwin"),
    )
}


def has_target(rustc: str, target: str) -> bool:
    """Whether a compiler has the standard library of a target."""
    found = subprocess.run([rustc, "--print", "target-libdir", "--target", target], capture_output=True, text=True, check=False)
    return found.returncode == 0 and any(Path(found.stdout.strip()).glob("libstd-*"))


def rust_environment(target: str) -> dict[str, str]:
    """The variables with which `cargo` builds for a target.

    Raises:
        WheelError: No Rust here can.
    """
    environment = dict(os.environ)
    environment.setdefault("MACOSX_DEPLOYMENT_TARGET", MACOS)
    if target == "x86_64-pc-windows-gnu":
        environment.setdefault("CARGO_TARGET_X86_64_PC_WINDOWS_GNU_LINKER", "x86_64-w64-mingw32-gcc")
    default = shutil.which("rustc")
    if default is not None and has_target(default, target):
        return environment
    debian, source = DEBIAN / "rustc", Path("/usr/lib/rustlib/src/rust/library")
    if not debian.is_file():
        raise WheelError(f"no Rust for {target}: rustup target add {target}, or apt install rustc-web cargo-web")
    environment |= {"PATH": f"{DEBIAN}{os.pathsep}{environment.get('PATH', '')}", "RUSTC": str(debian), "CARGO": str(DEBIAN / "cargo")}
    if has_target(str(debian), target):
        return environment
    if not source.is_dir():
        raise WheelError(f"no Rust for {target}: rustup target add {target}, or apt install rust-web-src")
    return environment | FROM_SOURCE


def build(platform: Platform, output: Path) -> Path:
    """Builds one wheel; returns its path.

    Raises:
        WheelError: It is not built on this system, or no wheel of this tag came of it.
        subprocess.CalledProcessError: maturin failed.
    """
    target = platform.rust_target()
    command = [sys.executable, "-m", "maturin", "build", "--release", "--locked", "--target", target, "--out", str(output)]
    environment = rust_environment(target)
    if platform.system == "linux":
        command += ["--zig", "--compatibility", GLIBC]
        environment["CARGO_ZIGBUILD_PYTHON_PATH"] = sys.executable  # which has ziglang
    subprocess.run(command, cwd=ROOT, env=environment, check=True)
    # maturin may name older platforms too where nothing newer is used.
    found = sorted(output.glob(f"hush_denoise-*-cp311-abi3-*{platform.tag}*.whl"), key=lambda path: path.stat().st_mtime)
    if not found:
        raise WheelError(f"maturin left no wheel for {platform.tag} in {output}")
    return found[-1]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("platform", nargs="*", metavar="PLATFORM", help="tags of wheels; see --list")
    parser.add_argument("--out", type=Path, default=Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target")) / "wheels")
    parser.add_argument("--list", action="store_true", help="all platforms of a release")
    chosen = parser.parse_args()
    if unknown := [tag for tag in chosen.platform if tag not in PLATFORMS]:
        parser.error(f"no such platform: {', '.join(unknown)}; there are {', '.join(PLATFORMS)}")
    if chosen.list or not chosen.platform:
        print("\n".join(PLATFORMS))
        return 0 if chosen.list else 2
    try:
        for tag in chosen.platform:
            wheel = build(PLATFORMS[tag], chosen.out)
            print(f"{wheel} ({wheel.stat().st_size / 1e6:.1f} MB)")
    except WheelError as error:
        print(f"build_wheel.py: {error}", file=sys.stderr)
        return 1
    except subprocess.CalledProcessError as error:
        print(f"build_wheel.py: {' '.join(map(str, error.cmd))} failed", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
