"""The house: rooms with one-way floors. What an import may reach is decided here, not in the heads of modules.

`FLOORS` lists the rooms of each package from the ground up; a room imports itself and the rooms above it in the list.
Imports inside functions and under TYPE_CHECKING count like any other: what a reader has to know is the same.
"""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter

import pytest

from tests.folders import ROOT

FLOORS = {
    "raytracer": (
        *("lecture", "files", "arrays", "predicates", "sampling", "scene", "textures", "processes", "casting", "film"),
        *(
            "subdivision",
            "surfaces",
            "bsdfs",
            "media",
            "shading",
            "lights",
            "caustics",
            "integrator",
            "rendering",
            "commands",
            "__init__",
            "__main__",
        ),
    ),
    "addon": (
        *("interrupts", "versions", "together", "passes", "properties", "editors", "handlers"),
        *("own_blender", "voxels", "extract", "scripting"),
        *(
            "scanning",
            "denoising",
            "viewport",
            "engine",
            "inspector",
            "compare",
            "panels",
            "registration",
            "commands",
            "presets",
            "__init__",
            "__main__",
        ),
    ),
}
# The public face of the ray tracer is what an add-on imports, but no room of the ray tracer itself.
FACE = "raytracer/__init__.py"
# The benchmark is a command of the repository: it finds `tests.benchmarks` by name and says so where it is missing.
REACHES_TESTS = {"addon/commands/bench.py"}
BLENDER = ("bpy", "mathutils", "gpu", "gpu_extras", "bl_ui", "bl_operators", "bpy_extras")


def list_files(package: str) -> list[str]:
    """Return the paths of a package's modules, relative to the project."""
    return sorted(path.relative_to(ROOT).as_posix() for path in (ROOT / package).rglob("*.py"))


def find_file(module: str) -> str | None:
    """Return the path of a module of the project, or None."""
    path = module.replace(".", "/")
    return next((name for name in (f"{path}.py", f"{path}/__init__.py") if (ROOT / name).is_file()), None)


def list_imports(file: str) -> Iterator[str]:
    """Yield the absolute names of all that a module imports, wherever it does so."""
    package = file.split("/")[:-1]
    for node in ast.walk(ast.parse((ROOT / file).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            module = ".".join([*base, *(node.module or "").split(".")]).strip(".")
            for alias in node.names:
                yield f"{module}.{alias.name}" if find_file(f"{module}.{alias.name}") else module


def list_strings(file: str) -> Iterator[str]:
    """Yield the strings of a module, which may name another to be imported."""
    for node in ast.walk(ast.parse((ROOT / file).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


def find_room(file: str) -> str:
    """Return the room that a module stands in: the name below its package."""
    return file.split("/")[1].removesuffix(".py")


def list_edges(package: str) -> list[tuple[str, str]]:
    """Return (importing, imported) for each import within a package, as paths."""
    edges = [(file, find_file(name)) for file in list_files(package) for name in list_imports(file)]
    return [(file, found) for file, found in edges if found and found.startswith(f"{package}/") and found != file]


def find_upward_imports(package: str, edges: list[tuple[str, str]]) -> list[str]:
    """Return a line for each import that leads to a higher floor, or to a room that no floor is known of."""
    floors = {room: number for number, room in enumerate(FLOORS[package])}
    unknown = sorted({room for edge in edges for room in map(find_room, edge) if room not in floors})
    upward = [f"{file} imports {found}" for file, found in edges if not unknown and
              floors[find_room(found)] > floors[find_room(file)]]  # fmt: skip
    return [*(f"{package}/{room} has no floor" for room in unknown), *upward]


def find_circle(edges: list[tuple[str, str]]) -> list[str]:
    """Return the modules of a circle of imports, or nothing."""
    graph: dict[str, set[str]] = {}
    for file, found in edges:
        graph.setdefault(file, set()).add(found)
    try:
        tuple(TopologicalSorter(graph).static_order())
    except CycleError as error:
        return list(error.args[1])
    return []


@pytest.mark.parametrize("package", FLOORS)
def test_rooms_import_only_the_floors_below(package: str) -> None:
    assert not find_upward_imports(package, list_edges(package))


@pytest.mark.parametrize("package", FLOORS)
def test_modules_do_not_import_one_another_in_a_circle(package: str) -> None:
    assert not find_circle(list_edges(package))


def test_an_upward_import_and_a_circle_are_seen() -> None:
    upward = ("raytracer/arrays/rows.py", "raytracer/film/film.py")
    assert find_upward_imports("raytracer", [upward]) == ["raytracer/arrays/rows.py imports raytracer/film/film.py"]
    assert find_circle([upward, upward[::-1]])
    assert not find_circle([upward])


def test_rooms_do_not_use_the_public_face() -> None:
    assert not [file for file, found in list_edges("raytracer") if found == FACE]


@pytest.mark.parametrize("package", FLOORS)
def test_the_product_does_not_reach_into_the_tests(package: str) -> None:
    reaching = [
        file
        for file in list_files(package)
        if any(name.split(".")[0] in ("tests", "blend_scenes") for name in list_imports(file))
        or (file not in REACHES_TESTS and any(text.startswith("tests.") for text in list_strings(file)))
    ]
    assert not reaching


def test_packages_hand_names_on_and_hold_no_code() -> None:
    for package in FLOORS:
        for file in list_files(package):
            if file.endswith("__init__.py") and file != "addon/__init__.py":
                body = ast.parse((ROOT / file).read_text(encoding="utf-8")).body
                kinds = (ast.Expr, ast.Import, ast.ImportFrom, ast.Assign)
                assert ast.get_docstring(ast.Module(body, [])), f"{file} does not say what the room is for"
                assert all(isinstance(node, kinds) for node in body), f"{file} holds code"


def test_the_ray_tracer_is_imported_whole_without_blender() -> None:
    modules = [file.removesuffix(".py").removesuffix("/__init__").replace("/", ".") for file in list_files("raytracer")]
    script = (
        f"import sys, importlib\nsys.modules.update(dict.fromkeys({BLENDER!r}))\n"
        f"for name in {modules!r}: importlib.import_module(name)\n"
        "print(len([name for name in sys.modules if name.split('.')[0] == 'raytracer']))"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) == len(modules)
    for file in list_files("raytracer"):
        blender = [name for name in list_imports(file) if name.split(".")[0] in (*BLENDER, "addon")]
        assert not blender, f"{file} imports {blender}"


# Products of a matrix of signs and exchanged axes, which nothing rounds.
EXACT_PRODUCTS = {"raytracer/shading/site.py"}
# Decisions have bounds of their own, which hold for any order of sums.
FREE_ROOMS = ("casting", "predicates")


def test_values_of_pictures_are_summed_in_one_order() -> None:
    """NumPy gives products of matrices to BLAS, whose order of sums, and so the last bit, is its processor's own."""
    found = []
    for file in list_files("raytracer"):
        if file in EXACT_PRODUCTS or file.split("/")[1] in FREE_ROOMS:
            continue
        for node in ast.walk(ast.parse((ROOT / file).read_text(encoding="utf-8"))):
            called = node.func if isinstance(node, ast.Call) else None
            is_product = isinstance(node, ast.BinOp) and isinstance(node.op, ast.MatMult)
            is_named = isinstance(called, ast.Attribute) and ast.unparse(called) in {
                f"np.{name}" for name in ("dot", "inner", "vdot", "matmul", "einsum", "tensordot")
            }
            if is_product or is_named:
                found.append(f"{file}:{getattr(node, 'lineno', 0)}")
    assert not found
