"""The asset files of the training shots (fetch_assets.py brings them); every list may be empty."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class Assets:
    hdris: list[str] = field(default_factory=list)
    normals: list[str] = field(default_factory=list)
    models: list[str] = field(default_factory=list)


def found(folder: Path) -> Assets:
    """What the folder holds, in a fixed order: a seed draws from these lists by index."""

    def named(pattern: str) -> list[str]:
        return sorted(str(path) for path in folder.glob(pattern))

    # The logo was left out from the first shot on, and the list fixes what a seed draws.
    models = [path for path in named("models_*.glb") if not path.endswith("pmndrs.glb")]
    return Assets(named("hdri_*.exr"), named("normals_*.webp"), models)
