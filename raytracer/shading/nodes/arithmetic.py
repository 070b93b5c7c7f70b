"""Numbers and vectors: Math, Vector Math, Clamp, Map Range, Mix of numbers and vectors, components, conversions.

Where mathematics has no answer (division by 0, the root of a negative number) the answer is Blender's, mostly 0.

References
----------
Blender, intern/cycles/kernel/svm/math_util.h, map_range.h, clamp.h, mix.h; intern/cycles/util/math.h.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from raytracer.arrays.rows import split_columns
from raytracer.arrays.vectors import normalize
from raytracer.lecture import cross, dot, length
from raytracer.shading.nodes.operation import Array, Operation, divide, mix, saturate, spread, stack

# Relative luminance of linear Rec. 709, Blender's default working space: how a color becomes a number.
LUMINANCE = np.array((0.2126, 0.7152, 0.0722))
# Blender's Compare treats numbers as equal that are this close, whatever its Epsilon.
FLOAT32_EPSILON = float(np.finfo(np.float32).eps)


def _power(base: Any, exponent: Any) -> Array:
    """base ** exponent, 0 for a negative base with a broken exponent and for 0 with a negative one."""
    base, exponent = np.broadcast_arrays(np.asarray(base, float), np.asarray(exponent, float))
    defined = np.where(base == 0, exponent >= 0, (base > 0) | (exponent == np.trunc(exponent)))
    return np.where(defined, np.power(np.where(defined, base, 1.0), exponent), 0.0)


def _logarithm(value: Any, base: Any) -> Array:
    defined = (np.asarray(value) > 0) & (np.asarray(base) > 0)
    value, base = np.where(defined, value, 1.0), np.where(defined, base, 1.0)
    return divide(np.log(value), np.log(base))


def _modulo(a: Any, b: Any) -> Array:
    """The remainder with the dividend's sign; 0 for division by 0."""
    usable = np.asarray(b) != 0
    return np.where(usable, np.fmod(a, np.where(usable, b, 1.0)), 0.0)


def _floored_modulo(a: Any, b: Any) -> Any:
    return np.where(np.asarray(b) != 0, a - np.floor(divide(a, b)) * b, 0.0)


def _snap(a: Any, b: Any) -> Any:
    return np.floor(divide(a, b)) * b


def _wrap(value: Any, high: Any, low: Any) -> Any:
    reach = np.asarray(high) - low
    return np.where(reach != 0, value - reach * np.floor(divide(value - np.asarray(low), reach)), low)


def _ping_pong(value: Any, scale: Any) -> Any:
    phase = divide(np.asarray(value) - scale, np.asarray(scale) * 2.0)
    folded = np.abs((phase - np.floor(phase)) * scale * 2.0 - scale)
    return np.where(np.asarray(scale) != 0, folded, 0.0)


def _smooth_minimum(a: Any, b: Any, reach: Any) -> Any:
    """The smaller number, less a cubic where the two are within `reach` of each other."""
    blend = divide(np.maximum(reach - np.abs(np.asarray(a) - b), 0.0), reach)
    return np.minimum(a, b) - np.where(np.asarray(reach) != 0, blend**3 * reach / 6.0, 0.0)


def _compare(a: Any, b: Any, epsilon: Any) -> Any:
    return np.abs(np.asarray(a) - b) <= np.maximum(epsilon, FLOAT32_EPSILON)


def _smooth_maximum(a: Any, b: Any, reach: Any) -> Any:
    return -_smooth_minimum(-np.asarray(a), -np.asarray(b), reach)


MATH: dict[str, Callable[[Any, Any, Any], Any]] = {
    "ADD": lambda a, b, c: a + b,
    "SUBTRACT": lambda a, b, c: a - b,
    "MULTIPLY": lambda a, b, c: a * b,
    "DIVIDE": lambda a, b, c: divide(a, b),
    "MULTIPLY_ADD": lambda a, b, c: a * b + c,
    "POWER": lambda a, b, c: _power(a, b),
    "LOGARITHM": lambda a, b, c: _logarithm(a, b),
    "SQRT": lambda a, b, c: np.sqrt(np.maximum(a, 0.0)),
    "INVERSE_SQRT": lambda a, b, c: divide(1.0, np.sqrt(np.maximum(a, 0.0))),
    "ABSOLUTE": lambda a, b, c: np.abs(a),
    "EXPONENT": lambda a, b, c: np.exp(a),
    "MINIMUM": lambda a, b, c: np.minimum(a, b),
    "MAXIMUM": lambda a, b, c: np.maximum(a, b),
    "LESS_THAN": lambda a, b, c: np.asarray(a) < b,
    "GREATER_THAN": lambda a, b, c: np.asarray(a) > b,
    "SIGN": lambda a, b, c: np.sign(a),
    "COMPARE": _compare,
    "SMOOTH_MIN": _smooth_minimum,
    "SMOOTH_MAX": _smooth_maximum,
    "ROUND": lambda a, b, c: np.floor(np.asarray(a) + 0.5),
    "FLOOR": lambda a, b, c: np.floor(a),
    "CEIL": lambda a, b, c: np.ceil(a),
    "TRUNC": lambda a, b, c: np.trunc(a),
    "FRACT": lambda a, b, c: a - np.floor(a),
    "MODULO": lambda a, b, c: _modulo(a, b),
    "FLOORED_MODULO": lambda a, b, c: _floored_modulo(a, b),
    "WRAP": _wrap,
    "SNAP": lambda a, b, c: _snap(a, b),
    "PINGPONG": lambda a, b, c: _ping_pong(a, b),
    "SINE": lambda a, b, c: np.sin(a),
    "COSINE": lambda a, b, c: np.cos(a),
    "TANGENT": lambda a, b, c: np.tan(a),
    "ARCSINE": lambda a, b, c: np.arcsin(np.clip(a, -1.0, 1.0)),
    "ARCCOSINE": lambda a, b, c: np.arccos(np.clip(a, -1.0, 1.0)),
    "ARCTANGENT": lambda a, b, c: np.arctan(a),
    "ARCTAN2": lambda a, b, c: np.arctan2(a, b),
    "SINH": lambda a, b, c: np.sinh(a),
    "COSH": lambda a, b, c: np.cosh(a),
    "TANH": lambda a, b, c: np.tanh(a),
    "RADIANS": lambda a, b, c: np.radians(a),
    "DEGREES": lambda a, b, c: np.degrees(a),
}


def compute_math(a: Any, b: Any, c: Any, *, operation: str, use_clamp: bool = False) -> Array:
    """One of MATH; what overflows becomes the largest number float32 has, as far as the picture goes."""
    result = np.asarray(MATH[operation](a, b, c), dtype=np.float64)
    return saturate(result) if use_clamp else result


def _project(a: Any, b: Any, c: Any, scale: Any) -> Array:
    return spread(divide(dot(a, b), dot(b, b))) * b


def _reflect(a: Any, b: Any, c: Any, scale: Any) -> Array:
    normal = normalize(np.asarray(b))
    return a - 2.0 * spread(dot(a, normal)) * normal


def _refract(a: Any, b: Any, c: Any, ior: Any) -> Array:
    """Snell's law for the incident direction a and the normal b; 0 in total reflection."""
    normal = normalize(np.asarray(b))
    along = dot(a, normal)
    inside = 1.0 - np.asarray(ior) ** 2 * (1.0 - along * along)
    bent = spread(ior) * a - spread(ior * along + np.sqrt(np.maximum(inside, 0.0))) * normal
    return np.where(spread(inside) < 0, 0.0, bent)


VECTOR_MATH: dict[str, Callable[[Any, Any, Any, Any], Any]] = {
    "ADD": lambda a, b, c, s: a + b,
    "SUBTRACT": lambda a, b, c, s: a - b,
    "MULTIPLY": lambda a, b, c, s: a * b,
    "DIVIDE": lambda a, b, c, s: divide(a, b),
    "MULTIPLY_ADD": lambda a, b, c, s: a * b + c,
    "CROSS_PRODUCT": lambda a, b, c, s: cross(*np.broadcast_arrays(a, b)),
    "PROJECT": _project,
    "REFLECT": _reflect,
    "REFRACT": _refract,
    "FACEFORWARD": lambda a, b, c, s: np.where(spread(dot(c, b)) < 0, a, -np.asarray(a)),
    "SCALE": lambda a, b, c, s: a * spread(s),
    "NORMALIZE": lambda a, b, c, s: normalize(np.asarray(a)),
    "ABSOLUTE": lambda a, b, c, s: np.abs(a),
    "POWER": lambda a, b, c, s: _power(a, b),
    "SIGN": lambda a, b, c, s: np.sign(a),
    "MINIMUM": lambda a, b, c, s: np.minimum(a, b),
    "MAXIMUM": lambda a, b, c, s: np.maximum(a, b),
    "FLOOR": lambda a, b, c, s: np.floor(a),
    "CEIL": lambda a, b, c, s: np.ceil(a),
    "FRACTION": lambda a, b, c, s: a - np.floor(a),
    "ROUND": lambda a, b, c, s: np.floor(np.asarray(a) + 0.5),
    "MODULO": lambda a, b, c, s: _modulo(a, b),
    "WRAP": lambda a, b, c, s: _wrap(a, b, c),
    "SNAP": lambda a, b, c, s: _snap(a, b),
    "SINE": lambda a, b, c, s: np.sin(a),
    "COSINE": lambda a, b, c, s: np.cos(a),
    "TANGENT": lambda a, b, c, s: np.tan(a),
}
VECTOR_NUMBERS: dict[str, Callable[[Any, Any], Any]] = {
    "DOT_PRODUCT": dot,
    "DISTANCE": lambda a, b: length(np.asarray(a) - b),
    "LENGTH": lambda a, b: length(a),
}


def compute_vector_math(a: Any, b: Any, c: Any, scale: Any, *, operation: str) -> Array:
    """One of VECTOR_MATH; 0 for the operations whose answer is a number."""
    return VECTOR_MATH[operation](a, b, c, scale) if operation in VECTOR_MATH else np.zeros(3)


def compute_vector_number(a: Any, b: Any, *, operation: str) -> Array:
    """One of VECTOR_NUMBERS; 0 for the operations whose answer is a vector."""
    return VECTOR_NUMBERS[operation](a, b) if operation in VECTOR_NUMBERS else np.zeros(())


def clamp(value: Any, low: Any, high: Any, *, clamp_type: str) -> Array:
    """The value cut to [low, high]; RANGE also takes the limits the other way round."""
    if clamp_type == "RANGE":
        low, high = np.minimum(low, high), np.maximum(low, high)
    return np.minimum(np.maximum(value, low), high)


def _map_linear(factor: Any, steps: Any) -> Any:
    return factor


def _map_stepped(factor: Any, steps: Any) -> Any:
    return np.where(np.asarray(steps) > 0, divide(np.floor(factor * (np.asarray(steps) + 1.0)), steps), 0.0)


def _map_smooth(factor: Any, steps: Any) -> Any:
    factor = saturate(factor)
    return factor * factor * (3.0 - 2.0 * factor)


def _map_smoother(factor: Any, steps: Any) -> Any:
    factor = saturate(factor)
    return factor**3 * (factor * (factor * 6.0 - 15.0) + 10.0)


MAP_RANGES = {"LINEAR": _map_linear, "STEPPED": _map_stepped, "SMOOTHSTEP": _map_smooth, "SMOOTHERSTEP": _map_smoother}


def map_range(
    value: Any, from_low: Any, from_high: Any, low: Any, high: Any, steps: Any, *, interpolation_type: str, clamp: bool
) -> Array:
    """low + f ((value - from_low) / (from_high - from_low)) (high - low), for numbers or each component of vectors."""
    factor = divide(np.asarray(value) - from_low, np.asarray(from_high) - from_low)
    result = low + MAP_RANGES[interpolation_type](factor, steps) * (np.asarray(high) - low)
    if clamp and interpolation_type in ("LINEAR", "STEPPED"):
        result = np.minimum(np.maximum(result, np.minimum(low, high)), np.maximum(low, high))
    return result


def map_range_of_number(
    value: Any, from_low: Any, from_high: Any, low: Any, high: Any, steps: Any, *, interpolation_type: str, clamp: bool
) -> Array:
    """`map_range`, 0 where the range that is mapped from is empty, or what is nearest to 0 in the one mapped to."""
    result = map_range(value, from_low, from_high, low, high, steps, interpolation_type=interpolation_type, clamp=clamp)
    nothing = np.minimum(np.maximum(0.0, np.minimum(low, high)), np.maximum(low, high)) if clamp else 0.0
    return np.where(np.asarray(from_low) == from_high, nothing, result)


def mix_numbers(factor: Any, a: Any, b: Any, *, clamp_factor: bool) -> Array:
    """a + (b - a) factor."""
    return mix(a, b, saturate(factor) if clamp_factor else factor)


def mix_vectors(factor: Any, factors: Any, a: Any, b: Any, *, factor_mode: str, clamp_factor: bool) -> Array:
    """a + (b - a) factor, with one factor or one for each component."""
    factor = spread(factor) if factor_mode == "UNIFORM" else factors
    return mix(a, b, saturate(factor) if clamp_factor else factor)


def separate(vector: Any) -> tuple[Any, Any, Any]:
    """The three components."""
    x, y, z = split_columns(np.asarray(vector))
    return x, y, z


def measure_luminance(color: Any) -> Array:
    """How a color becomes a number."""
    return dot(color, LUMINANCE)


def average(vector: Any) -> Array:
    """How a vector becomes a number."""
    return np.asarray(vector).sum(axis=-1) / 3.0


def repeat(value: Any) -> Array:
    """How a number becomes a vector or color."""
    return np.repeat(spread(value), 3, axis=-1)


VECTOR_OPERATIONS = (*VECTOR_MATH, *VECTOR_NUMBERS)
_RANGE = ("From Min", "From Max", "To Min", "To Max", "Steps")
_VECTOR_RANGE = tuple(f"{name.replace(' ', '_')}_FLOAT3" for name in _RANGE)
_VECTORS = ("Vector", "Vector_001", "Vector_002")

OPERATIONS = {
    "MATH": Operation(
        compute_math,
        ("Value", "Value_001", "Value_002"),
        settings=("operation", "use_clamp"),
        choices={"operation": MATH},
    ),
    "VECT_MATH Vector": Operation(
        compute_vector_math,
        (*_VECTORS, "Scale"),
        ("Vector",),
        ("operation",),
        choices={"operation": VECTOR_OPERATIONS},
    ),
    "VECT_MATH Value": Operation(
        compute_vector_number, _VECTORS[:2], ("Value",), ("operation",), choices={"operation": VECTOR_OPERATIONS}
    ),
    "CLAMP": Operation(clamp, ("Value", "Min", "Max"), ("Result",), ("clamp_type",)),
    "MAP_RANGE Result": Operation(
        map_range_of_number, ("Value", *_RANGE), ("Result",), ("interpolation_type", "clamp")
    ),
    "MAP_RANGE Vector": Operation(map_range, ("Vector", *_VECTOR_RANGE), ("Vector",), ("interpolation_type", "clamp")),
    "MIX Result_Float": Operation(
        mix_numbers, ("Factor_Float", "A_Float", "B_Float"), ("Result_Float",), ("clamp_factor",)
    ),
    "MIX Result_Vector": Operation(
        mix_vectors,
        ("Factor_Float", "Factor_Vector", "A_Vector", "B_Vector"),
        ("Result_Vector",),
        ("factor_mode", "clamp_factor"),
    ),
    "SEPXYZ": Operation(separate, ("Vector",), ("X", "Y", "Z")),
    "COMBXYZ": Operation(stack, ("X", "Y", "Z"), ("Vector",)),
    "RGBTOBW": Operation(measure_luminance, ("Color",), ("Val",)),
    # Conversions between kinds of sockets; these have no node.
    "color to number": Operation(measure_luminance, ("Value",)),
    "vector to number": Operation(average, ("Value",)),
    "number to vector": Operation(repeat, ("Value",)),
}
