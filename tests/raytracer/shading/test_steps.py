"""Steps of programs: what they compute, which of them run, and what folds."""

import inspect

import numpy as np
import pytest

from raytracer import (
    Closure,
    Image,
    Material,
    Mesh,
    Program,
    Register,
    Spheres,
    Step,
)
from raytracer.shading import evaluate as nodes_module
from raytracer.shading.evaluate import OPERATIONS, evaluate, find_needed, fold_step, list_attributes, run_step
from tests import meshes

UP = np.array([0.0, 0.0, 1.0])


def add(first, second):
    return Step("MATH", (first, second, 0.0), {"operation": "ADD"})


def read(name="uv"):
    return Step("ATTRIBUTE Vector", (), {"name": name})


def test_every_operation_names_what_its_function_takes():
    """As many inputs as arguments, and each setting a keyword."""
    for name, operation in OPERATIONS.items():
        parameters = list(inspect.signature(operation.compute).parameters.values())
        if any(item.kind == item.VAR_POSITIONAL for item in parameters):
            continue
        positional = [item for item in parameters if item.kind in (item.POSITIONAL_ONLY, item.POSITIONAL_OR_KEYWORD)]
        keywords = {item.name for item in parameters if item.kind == item.KEYWORD_ONLY}
        assert len(positional) == len(operation.inputs) + operation.reads_site, name
        assert keywords - {"parts"} == {*operation.settings, *(["evaluate"] if operation.runs_programs else [])}, name
        assert set(operation.links) <= set(operation.inputs), name
        assert set(operation.choices) <= set(operation.settings), name


def test_steps_run_in_order_and_feed_each_other():
    program = Program([add(1.0, 2.0), add(Register(0, "Value"), 4.0)])
    outputs = evaluate(program, None, (0, 1))
    assert outputs[Register(1, "Value")] == 7.0


def test_only_needed_steps_run(monkeypatch):
    program = Program([add(1.0, 2.0), add(8.0, 8.0), add(Register(0, "Value"), 4.0)])
    needed = find_needed(program, [Register(2, "Value"), 3.0])
    assert needed == (0, 2)
    ran = []
    monkeypatch.setattr(nodes_module, "run_step", lambda step, *rest: ran.append(step) or run_step(step, *rest))
    evaluate(program, None, needed)
    assert ran == [program.steps[0], program.steps[2]]


def test_pure_steps_of_constants_fold_and_others_do_not():
    assert fold_step(add(1.0, 2.0)) == {"Value": 3.0}
    assert fold_step(add(1.0, Register(0, "Value"))) is None
    assert fold_step(read()) is None
    (color,) = fold_step(Step("COMBINE_COLOR", (0.0, 1.0, 0.5), {"mode": "HSV"})).values()
    np.testing.assert_allclose(color, (0.5, 0, 0))


def test_what_overflows_folds_to_a_finite_number():
    (value,) = fold_step(Step("MATH", (1e38, 30.0, 0.0), {"operation": "POWER"})).values()
    assert np.isfinite(value)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Program([add(1.0, Register(0, "Value"))]), "expected a register of one of the 0 steps before it"),
        (lambda: Program([], Register(0, "Value")), "Program: result"),
        (lambda: Material([Closure("diffuse", color=Register(0, "Value"))]), "one of the 0 steps"),
        (lambda: add(np.zeros(2), 1.0), "a number, three numbers or a Register"),
        (lambda: add(np.nan, 1.0), "expected finite numbers"),
        (lambda: Image(np.zeros((2, 2, 3), np.uint8)), "Image '': pixels"),
        (lambda: Image(np.zeros((2, 2, 4), np.uint8), "gamma"), "encoding"),
        (lambda: Mesh(*meshes.make_quad(), attributes={"a": np.zeros((3, 1))}), "attribute 'a'"),
        (lambda: Mesh(*meshes.make_quad(), attributes={"a": np.zeros((4, 5))}), "attribute 'a'"),
        (lambda: Spheres([(0, 0, 0)], [1], attributes={"a": np.zeros((2, 1))}), "Spheres: attribute 'a'"),
        (lambda: Spheres([(0, 0, 0)], [1], attributes={"a": np.zeros((1, 3, 1))}), "Spheres: attribute 'a'"),
        (lambda: Spheres([(0, 0, 0)], [1], attributes=3), "Spheres: attributes"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(make, message):
    with pytest.raises(ValueError, match=message):
        make()


def test_attributes_that_programs_read_are_listed_inner_programs_included():
    inner = Program([read("inner")], Register(0, "Vector"))
    bump = Step("BUMP", (1.0, 1.0, 1.0, UP), {"height": inner, "invert": False})
    mapped = Step("NORMAL_MAP", (1.0, UP), {"space": "TANGENT", "name": "Second", "invert_green": False})
    assert list_attributes(Program([read("Col"), bump, mapped])) == {"Col", "inner", "tangent Second"}
