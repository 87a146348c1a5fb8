# SPDX-FileCopyrightText: 2026 Hush authors
# SPDX-License-Identifier: GPL-3.0-or-later
"""What Prepare Shot changed in a scene: remembered in it, and put back."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy

from . import messages

Owner = tuple[str, ...]


class Record:
    """What was changed in a scene and what was there before, kept in `scene.hush.prepared`."""

    def __init__(self, scene: bpy.types.Scene) -> None:
        self.scene = scene
        self._first = scene.hush.prepared
        try:
            stored = json.loads(self._first or "{}")
        except ValueError:
            stored = {}
        stored = stored if isinstance(stored, dict) else {}
        self.vector_layer: str | None = stored.get("vector_layer")
        self._first_layer = self.vector_layer
        # [owner, property, before, after]: all that is remembered, and what is new among it.
        self.values: list[list[Any]] = stored.get("values", [])
        self._fresh: list[list[Any]] = []

    def save(self) -> None:
        """Writes it into the scene; nothing where nothing is changed."""
        there = {"vector_layer": self.vector_layer, "values": self.values}
        text = json.dumps(there) if self.values or self.vector_layer else ""
        if text != self.scene.hush.prepared:
            self.scene.hush.prepared = text

    def owner(self, path: Owner) -> Any:  # noqa: ANN401 (any Blender struct)
        """What a path such as ("view_layers", "ViewLayer", "cycles") names, None where it is gone."""
        found: Any = self.scene
        for part in path:
            found = found.get(part) if isinstance(found, bpy.types.bpy_prop_collection) else getattr(found, part, None)
        return found

    def set(self, path: Owner, name: str, value: Any) -> bool:  # noqa: ANN401 (any property's value)
        """Sets a property; False where it had that value already."""
        owner = self.owner(path)
        before = getattr(owner, name)
        if before == value:
            return False
        setattr(owner, name, value)
        self._remember(path, name, before, getattr(owner, name))
        return True

    @contextmanager
    def watching(self, path: Owner, names: tuple[str, ...]) -> Iterator[Any]:
        """Remembers what changes among these properties, also those that Blender changes by itself."""
        owner = self.owner(path)
        before = {name: getattr(owner, name) for name in names if hasattr(owner, name)}
        yield owner
        for name, value in before.items():
            if getattr(owner, name) != value:
                self._remember(path, name, value, getattr(owner, name))

    def take_back(self) -> None:
        """Puts back what was changed since this record was made; what was remembered before stays."""
        _put_back(self, self._fresh)
        if self.vector_layer != self._first_layer:
            _remove_layer(self.scene, self.vector_layer)
        self.scene.hush.prepared = self._first

    def _remember(self, path: Owner, name: str, before: object, after: object) -> None:
        for entries in (self.values, self._fresh):
            _note(entries, path, name, before, after)


def undo(scene: bpy.types.Scene) -> list[str]:
    """Puts back what was there before; what was changed by hand since stays. Tells what could not be put back."""
    record = Record(scene)
    left = _put_back(record, record.values)
    if record.vector_layer and record.vector_layer not in scene.view_layers:
        # Also where it was only renamed, and is another to whoever looks for it by its name.
        left.append(messages.text("undo_layer_gone", layer=record.vector_layer))
    _remove_layer(scene, record.vector_layer)
    scene.hush.prepared = ""
    return left


def _put_back(record: Record, values: list[list[Any]]) -> list[str]:
    left = []
    # All are looked at before any is set: setting one, such as the file format, changes others.
    by_hand = [entry for entry in values if _now(record, entry) not in entry[2:]]
    for entry in values:
        path, name, before, _ = entry
        owner = record.owner(tuple(path))
        if owner is None:
            # Only view layers come and go.
            left.append(messages.text("undo_gone", layer=path[1]))
        elif entry in by_hand:
            left.append(messages.text("undo_by_hand", name=_label(owner, path, name)))
        else:
            try:
                setattr(owner, name, before)
            except (TypeError, AttributeError) as error:
                left.append(messages.text("undo_failed", name=_label(owner, path, name), reason=error))
    return list(dict.fromkeys(left))


def _label(owner: bpy.types.bpy_struct, path: list[str], name: str) -> str:
    """What Blender calls a property, with its view layer."""
    label = owner.bl_rna.properties[name].name
    return f"View layer {path[1]} › {label}" if path[:1] == ["view_layers"] else label


def _remove_layer(scene: bpy.types.Scene, name: str | None) -> None:
    layer = scene.view_layers.get(name or "")
    if layer is not None and len(scene.view_layers) > 1:
        scene.view_layers.remove(layer)


def _note(entries: list[list[Any]], path: Owner, name: str, before: object, after: object) -> None:
    """Adds a change, or the newer value to the one that is there."""
    for entry in entries:
        if entry[:2] == [list(path), name]:
            entry[3] = after
            return
    entries.append([list(path), name, before, after])


def _now(record: Record, entry: list[Any]) -> object:
    return getattr(record.owner(tuple(entry[0])), entry[1], None)
