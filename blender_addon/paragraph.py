# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""Text in lines that fit, and a button beside it; labels alone are cut off, and halved by what stands beside them.

Widths are in the interface's own units, pixels at resolution scale 1. What Blender puts around a text was measured in a window of 4.3.
"""

from functools import lru_cache

import blf
import bpy

# From the edges of a region to those of a panel's contents, with the room that a scroll bar takes.
_MARGINS = 36.0
# The column of tabs that a sidebar has, and what a popup has at its edges.
_TABS = 20.0
_POPUP = 14.0
# Around the text of a label, and the icon before it.
_AROUND = 8.0
_ICON = 20.0
# In a panel drawn together to nothing text is cut off and not stood on end.
_LEAST = 60.0
# The room for `Fix`.
_BUTTON = 50.0


def width(context: bpy.types.Context) -> float:
    """Of a panel's contents."""
    region = context.region
    tabs = _TABS if region.type == "UI" else 0.0
    return region.width / (context.preferences.system.ui_scale or 1.0) - _MARGINS - tabs


def popup_width(of: int) -> float:
    """Of the contents of a popup."""
    return of - _POPUP


def draw(column: bpy.types.UILayout, text: str, width: float, *, icon: str = "NONE") -> None:
    """Text in as many lines as it takes."""
    room = max(width - _AROUND - (_ICON if icon != "NONE" else 0.0), _LEAST)
    for number, line in enumerate(lines(text, room, _points()) or ("",)):
        column.label(text=line, icon=icon if number == 0 else "BLANK1" if icon != "NONE" else "NONE")


def draw_with_fix(column: bpy.types.UILayout, text: str, width: float, *, icon: str, fix: tuple[str, dict[str, object]] | None) -> None:
    """The same, with a button for an operator with its arguments where there is one."""
    if fix is None:
        draw(column.column(align=True), text, width, icon=icon)
        return
    # A plain row would share its width by what the parts would like.
    row = column.split(factor=1.0 - _BUTTON / max(width, 2 * _BUTTON))
    draw(row.column(align=True), text, width - _BUTTON, icon=icon)
    operator, arguments = fix
    button = row.row().operator(operator, text="Fix")
    for name, value in arguments.items():
        setattr(button, name, value)


@lru_cache(maxsize=512)
def lines(text: str, room: float, points: float) -> tuple[str, ...]:
    """Cuts a text at its blanks; a word, such as a path, that is wider than the room is cut anywhere."""
    found, line = [], ""
    for word in text.split():
        longer = f"{line} {word}" if line else word
        if _width_of(longer, points) <= room:
            line = longer
            continue
        if line:
            found.append(line)
        while _width_of(word, points) > room and len(word) > 1:
            fitting = next((n for n in range(len(word) - 1, 1, -1) if _width_of(word[:n], points) <= room), 1)
            found.append(word[:fitting])
            word = word[fitting:]
        line = word
    return (*found, line) if line else tuple(found)


def _width_of(text: str, points: float) -> float:
    blf.size(0, points)
    return blf.dimensions(0, text)[0]


def _points() -> float:
    return bpy.context.preferences.ui_styles[0].widget.points
