"""Hush takes the noise out of Blender Cycles animations, with less flicker than frame by frame.

For files: `denoise_sequence`, `dry_run_sequence`, `check_sequence`, `survey_sequence`, `inspect`. For one frame of them, to choose
settings: `preview`, `preview_sheet`. For images in memory: `denoise` and `Denoiser`. `main` is the command line.
"""

from __future__ import annotations

from ._command import main
from ._hush import LAMBDA_RANGE, MAX_WINDOW, Denoised, Denoiser, HushError, __version__, denoise
from ._preview import preview, preview_sheet
from ._sequence import SequenceCheck, check_sequence, denoise_sequence, dry_run_sequence, inspect, survey_sequence
from ._settings import SequenceSettings, ShotSettings
from ._stage_reader import register as _register_stage_reader

__all__ = [
    "LAMBDA_RANGE",
    "MAX_WINDOW",
    "Denoised",
    "Denoiser",
    "HushError",
    "SequenceCheck",
    "SequenceSettings",
    "ShotSettings",
    "__version__",
    "check_sequence",
    "denoise",
    "denoise_sequence",
    "dry_run_sequence",
    "inspect",
    "main",
    "preview",
    "preview_sheet",
    "survey_sequence",
]

_register_stage_reader()
