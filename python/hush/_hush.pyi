"""The half that is written in Rust. Private, but for what `hush` takes from it."""

import os
from collections.abc import Callable
from typing import Final

LAMBDA_RANGE: Final[tuple[float, float]]
MAX_WINDOW: Final[int]
__version__: Final[str]

class HushError(Exception):
    """What is neither a TypeError, a ValueError nor an OSError: a damaged file, a missing pass, unusable weights, too little memory."""

def main(args: list[str]) -> int: ...
def inspect(path: str | os.PathLike[str]) -> str: ...
def plan_sequence(options: dict[str, object]) -> str: ...
def denoise_sequence(
    options: dict[str, object], progress: Callable[[str], object] | None, cancel: Callable[[], object] | None
) -> str: ...
