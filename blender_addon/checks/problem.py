# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""One thing that Check Shot finds."""

from dataclasses import dataclass

from .. import messages

ERROR, WARNING, INFO = "ERROR", "WARNING", "INFO"


@dataclass(frozen=True)
class Problem:
    """One thing that is not right. `key` is also the fix's, for `bpy.ops.hush.fix(key=…)`; `fix` is that operator and its arguments."""

    key: str
    text: str
    fix: tuple[str, dict[str, object]] | None = None
    level: str = WARNING


def problem(key: str, message: str, level: str = WARNING, *, fix_in: str = "", **fields: object) -> Problem:
    """A problem in the words of a message; `fix_in` names the scene in which the Fix button mends it."""
    fix = ("hush.fix", {"key": key, "scene": fix_in}) if fix_in else None
    return Problem(key, messages.text(message, **fields), fix, level)
