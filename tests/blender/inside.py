"""Run inside Blender: runs the tests of one case. Arguments: the case, the file for results."""

from __future__ import annotations

import importlib.util
import json
import sys
import time
import traceback
from pathlib import Path

import bpy
import kit


def main() -> None:
    case, results = Path(sys.argv[1]), Path(sys.argv[2])
    spec = importlib.util.spec_from_file_location(case.stem, case)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    with results.open("w", encoding="utf-8", buffering=1) as lines:

        def tell(name: str, began: float, error: str | None) -> None:
            lines.write(json.dumps({"test": name, "seconds": time.perf_counter() - began, "error": error}) + "\n")

        began = time.perf_counter()
        try:
            if not case.read_text(encoding="utf-8").count("\nENABLE = False\n"):
                kit.enable()
            spec.loader.exec_module(module)
            tests = {name: test for name, test in vars(module).items() if name.startswith("test_") and callable(test)}
            assert tests, f"{case.name} has no function test_…"
        except BaseException:
            tell("(loading)", began, traceback.format_exc())
            return
        for name, test in tests.items():
            print(f"--- {name}", flush=True)
            began = time.perf_counter()
            bpy.ops.wm.read_homefile(use_empty=True)
            try:
                test()
                error = None
            except BaseException:
                error = traceback.format_exc()
                print(error, flush=True)
            tell(name, began, error)


main()
