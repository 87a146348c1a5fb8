# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether two paths mean one file: through links and mapped drives, and in other letter case where the system makes no difference."""

import os
import sys

# Windows and macOS. Their file systems can be made to tell letter cases apart; then two files are taken for one, which loses nothing.
IGNORES_CASE = sys.platform in ("win32", "darwin")


def folded(name: str) -> str:
    """What the names of one file have in common."""
    return name.casefold() if IGNORES_CASE else name


def place(path: str | os.PathLike[str]) -> str:
    """What the paths of one file or folder have in common, which need not be there. A link as the last name is not followed."""
    folder, name = os.path.split(os.path.normpath(path))
    return folded(os.path.join(os.path.realpath(folder), name))


def place_of_folder(folder: str | os.PathLike[str]) -> str:
    """As `place`, also where the folder itself is a link."""
    return folded(os.path.realpath(folder))
