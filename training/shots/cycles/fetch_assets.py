"""Fetches the CC0 assets of the training shots: the HDRIs, models and normal maps of the npm package @pmndrs/assets.

    python -m training.shots.cycles.fetch_assets runs/assets   # hdri_*.exr, models_*.glb, normals_*.webp; wants npm

The package holds each file as a JavaScript module, `export default 'data:…;base64,…'`; this decodes them.
"""

from __future__ import annotations

import argparse
import base64
import subprocess
import tarfile
import tempfile
from pathlib import Path, PurePosixPath

PACKAGE = "@pmndrs/assets@1.7.0"
KINDS = {"hdri": ".exr", "models": ".glb", "normals": ".webp"}


def packed(folder: Path) -> Path:
    """Downloads the package's archive into the folder."""
    subprocess.run(["npm", "pack", "--silent", PACKAGE], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    return next(folder.glob("*.tgz"))


def decoded(module: str) -> bytes:
    """The bytes in a module's data URL."""
    head, found, rest = module.partition(";base64,")
    if not found or "data:" not in head:
        raise ValueError("no base64 data URL in the module")
    return base64.b64decode(rest[: rest.index("'")], validate=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=Path, help="folder for the decoded files")
    output: Path = parser.parse_args().output
    output.mkdir(parents=True, exist_ok=True)
    count = 0
    with tempfile.TemporaryDirectory() as scratch, tarfile.open(packed(Path(scratch))) as archive:
        for member in archive:
            path = PurePosixPath(member.name)  # package/hdri/city.exr.js
            if path.suffix != ".js" or not path.stem.endswith(KINDS.get(path.parent.name, "\0")):
                continue
            source = archive.extractfile(member)
            if source is None:
                continue
            (output / f"{path.parent.name}_{path.stem}").write_bytes(decoded(source.read().decode("ascii")))
            count += 1
    print(f"{count} files in {output}")


if __name__ == "__main__":
    main()
