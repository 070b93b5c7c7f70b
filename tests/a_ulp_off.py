"""Hits as another libm and another BLAS would give them: `python -m tests.a_ulp_off [libm] [blas] [linalg]`.

Prints hashes of what rays hit in random scenes, and how many results were moved. With "libm" every result of exp, log,
pow, sin and their like is moved by an ulp, up or down; with "blas" every result of a matrix product, and with "linalg"
of NumPy's linear algebra. Additions, products, quotients and square roots are left alone: IEEE 754 says what they are
on every machine. A process of its own: modules are changed as they are read.
"""

from __future__ import annotations

import ast
import builtins
import hashlib
import math
import sys
from importlib import machinery
from typing import Any

import numpy as np

LIBM = (
    *("exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "power", "float_power", "cbrt", "hypot"),
    *("sin", "cos", "tan", "arcsin", "arccos", "arctan", "arctan2", "sinh", "cosh", "tanh"),
)
MATH = ("exp", "log", "log2", "log10", "pow", "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "hypot", "cbrt")
BLAS = ("matmul", "dot", "vdot", "inner", "tensordot", "einsum")
LINALG = ("inv", "solve", "det", "norm")
_calls = 0


def nudge(values: Any) -> Any:
    """Return floating point values moved by an ulp: up in one call, down in the next; others as they are."""
    global _calls
    _calls += 1
    if isinstance(values, tuple) or not np.issubdtype(np.asarray(values).dtype, np.floating):
        return values
    moved = np.nextafter(values, np.asarray(np.inf if _calls % 2 else -np.inf, np.asarray(values).dtype))
    return float(moved) if isinstance(values, float) else moved


def wrap(module: Any, names: tuple[str, ...]) -> None:
    """Nudge what functions of a module return."""
    for name in names:
        if hasattr(module, name):
            true = getattr(module, name)
            setattr(module, name, lambda *values, true=true, **options: nudge(true(*values, **options)))


class Products(ast.NodeTransformer):
    """Turns a @ b and a ** b into calls that are nudged, but for powers that are exact or products: of 2, squares."""

    def __init__(self, names: tuple[str, ...]) -> None:
        self._names = names

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        name = {ast.MatMult: "matmul", ast.Pow: "power"}.get(type(node.op), "")
        exact = ast.unparse(node.left) in ("2", "2.0") or ast.unparse(node.right) in ("2", "0.5")
        if name not in self._names or (name == "power" and exact):
            return node
        return ast.Call(ast.Name(f"nudged_{name}", ast.Load()), [node.left, node.right], [])


def change_modules(names: tuple[str, ...]) -> None:
    """Have the operators of the ray tracer's modules nudged as they are read."""
    builtins.nudged_matmul = lambda left, right: nudge(left @ right)  # type: ignore[attr-defined]
    builtins.nudged_power = lambda base, exponent: nudge(base**exponent)  # type: ignore[attr-defined]
    read = machinery.SourceFileLoader.source_to_code

    def source_to_code(self: Any, data: Any, path: Any, **options: Any) -> Any:
        if "raytracer" in self.name.split(".")[:1]:
            data = ast.fix_missing_locations(Products(names).visit(ast.parse(data)))
        return read(self, data, path, **options)

    machinery.SourceFileLoader.source_to_code = source_to_code  # type: ignore[method-assign,assignment]
    # Compiled modules would be read as they are.
    machinery.SourceFileLoader.get_code = lambda self, name: self.source_to_code(  # type: ignore[method-assign]
        self.get_data(self.get_filename(name)), self.get_filename(name)
    )


def hash_hits() -> tuple[str, str]:
    """Return hashes of the decisions and of the distances of rays in scenes of triangles, spheres and instances."""
    import raytracer
    from raytracer import Instances, Mesh, Scene, Spheres

    decisions, distances = hashlib.sha256(), hashlib.sha256()
    generator = np.random.default_rng(3)
    for turn in range(4):
        corners = generator.uniform(-1.0, 1.0, (900, 3))
        corners[::7] = np.round(4.0 * corners[::7]) / 4.0  # many in common planes, edges and vertices
        mesh = Mesh(corners, generator.integers(0, 900, (300, 3)))
        matrices = np.tile(np.eye(4), (3, 1, 1))
        matrices[:, :3, :3] += generator.uniform(-0.5, 0.5, (3, 3, 3))
        matrices[1:, :3, 3] = generator.uniform(-2.0, 2.0, (2, 3))
        spheres = Spheres(generator.uniform(-2.0, 2.0, (20, 3)), generator.uniform(0.05, 0.5, 20))
        scene = Scene([mesh], spheres, Instances([0, 0, 0], matrices) if turn % 2 else None)
        caster = raytracer.build(scene)
        origins = np.where(generator.random((3000, 1)) < 0.5, 0.25, generator.uniform(-2.0, 2.0, (3000, 3)))
        targets = np.concatenate([corners[generator.integers(0, 900, 1500)], generator.uniform(-1, 1, (1500, 3))])
        hits = caster.closest_hit(origins, targets - origins)
        blocked = caster.any_hit(origins, targets - origins, 0.0, 1.0)
        counts = caster.crossings(origins, targets - origins)
        for array in (hits.instance, hits.primitive, hits.valid, blocked, counts):
            decisions.update(np.ascontiguousarray(array).tobytes())
        distances.update(hits.distance.tobytes() + hits.barycentric.tobytes() + hits.distance_error.tobytes())
    return decisions.hexdigest()[:16], distances.hexdigest()[:16]


def main() -> None:
    """Change what is asked for, then cast."""
    names = sys.argv[1:]
    operators: tuple[str, ...] = ()
    if "libm" in names:
        wrap(np, LIBM)
        wrap(math, MATH)
        operators += ("power",)
    if "blas" in names:
        wrap(np, BLAS)
        operators += ("matmul",)
    if "linalg" in names:
        wrap(np.linalg, LINALG)
    change_modules(operators)
    print(*hash_hits(), _calls)


if __name__ == "__main__":
    main()
