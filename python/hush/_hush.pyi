"""The half that is written in Rust. Private, but for what `hush` takes from it."""

import os
from collections.abc import Callable, Sequence
from typing import Any, Final, TypeAlias, final

import numpy as np
import numpy.typing as npt

__all__ = [
    "LAMBDA_RANGE",
    "MAX_WINDOW",
    "Denoised",
    "Denoiser",
    "HushError",
    "SequenceCheck",
    "__version__",
    "denoise",
    "denoise_sequence",
    "inspect",
    "main",
    "dry_run_sequence",
    "survey_sequence",
    "preview",
    "preview_sheet",
    "read_stages_with",
]

LAMBDA_RANGE: Final[tuple[float, float]]
MAX_WINDOW: Final[int]
__version__: Final[str]

_Floats: TypeAlias = npt.NDArray[np.floating[Any]]
_Number: TypeAlias = float | np.floating[Any] | np.integer[Any]
_Image: TypeAlias = npt.NDArray[np.float32]
_Path: TypeAlias = str | os.PathLike[str]

class HushError(Exception): ...

def denoise(
    color: _Floats,
    albedo: _Floats | None = None,
    normal: _Floats | None = None,
    depth: _Floats | None = None,
    vector: _Floats | None = None,
    *,
    lam: _Number | _Floats = 1.0,
    out: _Image | None = None,
    memory: int | None = None,
    threads: int | None = None,
    model: _Path | None = None,
    renderer: str | None = None,
) -> _Image: ...
@final
class Denoised:
    @property
    def color(self) -> _Image: ...
    @property
    def aovs(self) -> dict[str, _Image]: ...
    @property
    def tag(self) -> Any: ...  # noqa: ANN401

@final
class Denoiser:
    def __new__(
        cls,
        window: int = 2,
        lam: _Number = 1.0,
        *,
        model: _Path | None = None,
        renderer: str | None = None,
        memory: int | None = None,
        threads: int | None = None,
        second_pass: bool = False,
    ) -> Denoiser: ...
    @property
    def window(self) -> int: ...
    @property
    def lam(self) -> float: ...
    @property
    def pending(self) -> int: ...
    def push(
        self,
        color: _Floats,
        albedo: _Floats | None = None,
        normal: _Floats | None = None,
        depth: _Floats | None = None,
        vector: _Floats | None = None,
        *,
        aovs: dict[str, _Floats] | None = None,
        lam: _Number | _Floats | None = None,
        tag: object = None,
    ) -> list[Denoised]: ...
    def flush(self) -> list[Denoised]: ...

def read_stages_with(command: Sequence[str], reason: str) -> None: ...
def main(args: Sequence[str]) -> int: ...
def inspect(path: _Path) -> str: ...
def dry_run_sequence(options: dict[str, Any]) -> str: ...
def survey_sequence(options: dict[str, Any], timing: bool) -> str: ...
def denoise_sequence(options: dict[str, Any], progress: Callable[[str], object] | None, cancel: Callable[[], object] | None) -> str: ...
@final
class SequenceCheck:
    def __new__(cls) -> SequenceCheck: ...
    def check(self, options: dict[str, Any]) -> str: ...

def preview(options: dict[str, Any], progress: Callable[[float], object] | None, cancel: Callable[[], object] | None) -> dict[str, Any]: ...
def preview_sheet(
    options: dict[str, Any], progress: Callable[[float], object] | None, cancel: Callable[[], object] | None
) -> dict[str, Any]: ...
