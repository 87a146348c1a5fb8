"""All of the open file as plain values, to compare before and after: every data-block with its users, links, keys and settings."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy

# Of the window: what is open and where, not what is in the file.
_WINDOW = {"window_managers", "screens", "workspaces"}
# What Blender counts, fills or turns by itself when it is read; the brushes; two UV layers that 4.x makes up anew each time.
_VOLATILE = {"rna_type", "session_uid", "is_evaluated", "is_runtime_data", "original", "id_data", "bindcode", "has_data", "pixels"}
_VOLATILE |= {"depsgraph", "preview", "render_slots", "is_loaded", "internal_links", "tool_settings", "users"}
_VOLATILE |= {"uv_layer_clone", "uv_layer_stencil", "storage_type"}
_SIMPLE = {"BOOLEAN", "INT", "FLOAT", "STRING", "ENUM"}

Fingerprint = dict[str, Any]


def take() -> Fingerprint:
    """The file now: `path`, `dirty` and each data-block by kind and full name."""
    found: Fingerprint = {"path": bpy.data.filepath, "dirty": bpy.data.is_dirty}
    found["open scene"] = bpy.context.scene.name_full if bpy.context.scene else None
    for kind, blocks in collections():
        for block in blocks:
            if block.name == "Render Result":
                continue
            place = f"{kind}/{block.name_full}"
            found[place] = {"users": block.users, "fake": block.use_fake_user, "library": block.library and block.library.filepath}
            if kind not in _WINDOW:
                found[place] |= values(block)
    return found


def collections() -> Iterator[tuple[str, Any]]:
    """The kinds of data-blocks, by name."""
    for each in bpy.data.bl_rna.properties:
        if each.type == "COLLECTION":
            yield each.identifier, getattr(bpy.data, each.identifier)


def values(owner: Any, seen: set[tuple[type, int]] | None = None) -> Fingerprint:  # noqa: ANN401 (any Blender struct)
    """Everything an RNA struct says, by path; other data-blocks by name only, and each struct once."""
    found: Fingerprint = {}
    seen = set() if seen is None else seen
    seen.add((type(owner), owner.as_pointer()))
    for each in owner.bl_rna.properties:
        name = each.identifier
        if name in _VOLATILE:
            continue
        try:
            value = getattr(owner, name)
        except (AttributeError, RuntimeError, UnicodeDecodeError):
            continue
        if each.type in _SIMPLE:
            found[name] = tuple(value) if getattr(each, "is_array", False) else sorted(value) if isinstance(value, set) else value
        elif each.type == "POINTER":
            found |= {f"{name}.{key}": kept for key, kept in _inner(owner, value, seen).items()}
        elif each.type == "COLLECTION":
            for number, item in enumerate(value):
                found |= {f"{name}[{number}].{key}": kept for key, kept in _inner(owner, item, seen).items()}
    if isinstance(owner, bpy.types.NodeTree):
        ends = lambda link: (link.from_node.name, link.from_socket.identifier, link.to_node.name, link.to_socket.identifier)
        found["link ends"] = sorted(ends(link) for link in owner.links)
    try:
        found |= {f"[{key!r}]": _plain(owner[key]) for key in owner.keys()}  # noqa: SIM118 (not a dict)
    except (AttributeError, TypeError):
        # A struct that holds no custom properties.
        pass
    return found


def _inner(owner: Any, value: Any, seen: set[tuple[type, int]]) -> Fingerprint:  # noqa: ANN401
    if value is None:
        return {"": None}
    if isinstance(value, bpy.types.ID) and not getattr(value, "is_embedded_data", False):
        return {"": value.name_full}
    # What a link or a node points at is described in the tree's own list.
    points = isinstance(owner, (bpy.types.NodeLink, bpy.types.Node)) and isinstance(value, bpy.types.Node)
    if points or isinstance(owner, bpy.types.NodeLink) or not isinstance(value, bpy.types.bpy_struct):
        return {"": getattr(value, "name", type(value).__name__)}
    if (type(value), value.as_pointer()) in seen:
        return {"": getattr(value, "name", type(value).__name__)}
    return values(value, seen)


def _plain(value: Any) -> Any:  # noqa: ANN401
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if hasattr(value, "to_list"):
        return value.to_list()
    return value.name_full if isinstance(value, bpy.types.ID) else value


def changes(before: Fingerprint, after: Fingerprint) -> list[str]:
    """What differs, in words."""
    told = []
    for key in sorted(before.keys() | after.keys()):
        if key not in after:
            told.append(f"{key} is gone")
        elif key not in before:
            told.append(f"{key} is new")
        elif isinstance(before[key], dict):
            inner = before[key], after[key]
            names = sorted(inner[0].keys() | inner[1].keys())
            told += [f"{key}: {n} {inner[0].get(n)!r} → {inner[1].get(n)!r}" for n in names if inner[0].get(n) != inner[1].get(n)]
        elif before[key] != after[key]:
            told.append(f"{key}: {before[key]!r} → {after[key]!r}")
    return told
