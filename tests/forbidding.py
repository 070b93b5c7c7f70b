"""Makes stages of the bounce loop fail that a scene should not need."""

from __future__ import annotations

import sys
from typing import Any

import raytracer  # noqa: F401  (so that all of its modules are loaded)


def forbid(monkeypatch: Any, *names: str) -> None:
    """Make the functions of these names fail wherever the ray tracer calls them.

    A function is found by what it is, not by where it stands: every loaded module of the ray tracer that holds the
    same object under any name is patched, so that no move of a module or an import can blind the tests.
    """

    def fail(*arguments: Any, **keywords: Any) -> None:
        raise AssertionError("a stage was called that the scene does not need")

    modules = [module for name, module in sorted(sys.modules.items()) if name.split(".")[0] == "raytracer"]
    for name in names:
        stages = {id(found): found for module in modules if callable(found := vars(module).get(name))}
        assert len(stages) == 1, f"expected one function {name} in the ray tracer, found {len(stages)}"
        (stage,) = stages.values()
        for module in modules:
            for alias in [alias for alias, value in vars(module).items() if value is stage]:
                monkeypatch.setattr(module, alias, fail)
