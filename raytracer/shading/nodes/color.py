"""Colors: spaces, Mix with its blend modes, and the nodes that adjust a color.

References
----------
A. R. Smith, "Color Gamut Transform Pairs", SIGGRAPH 1978: hue, saturation, value.
Blender, intern/cycles/kernel/svm/color_util.h, hsv.h, brightness.h, gamma.h, invert.h: blend modes and adjustments.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from raytracer.shading.nodes.arithmetic import separate
from raytracer.shading.nodes.operation import Array, Operation, divide, mix, saturate, spread, stack


def to_hue(color: Any) -> tuple[Array, Array, Array]:
    """Return hue, from 0 to 1 and 0 for grey, and the largest and the smallest component of RGB (..., 3)."""
    red, green, blue = separate(color)
    high, low = np.maximum(np.maximum(red, green), blue), np.minimum(np.minimum(red, green), blue)
    reach = high - low
    sector = np.where(
        red == high,
        divide(green - blue, reach),
        np.where(green == high, 2.0 + divide(blue - red, reach), 4.0 + divide(red - green, reach)),
    )
    hue = np.where(reach != 0, sector / 6.0, 0.0)
    return np.where(hue < 0, hue + 1.0, hue), high, low


def to_hsv(color: Any) -> Array:
    """Hue, saturation, value of RGB; without hue where the value is 0, though parts are negative."""
    hue, high, low = to_hue(color)
    return stack(np.where(high != 0, hue, 0.0), divide(high - low, high), high)


def to_hsl(color: Any) -> Array:
    """Hue, saturation, lightness of RGB."""
    hue, high, low = to_hue(color)
    lightness = np.minimum((high + low) / 2.0, 1.0)
    reach = high - low
    saturation = np.where(lightness > 0.5, divide(reach, 2.0 - high - low), divide(reach, high + low))
    return stack(hue, saturation, lightness)


def make_hue(hue: Any) -> Array:
    """Return the pure color (..., 3) of a hue from 0 to 1."""
    angle = spread(hue) * 6.0
    red, green, blue = np.abs(angle - 3.0) - 1.0, 2.0 - np.abs(angle - 2.0), 2.0 - np.abs(angle - 4.0)
    return saturate(np.concatenate([red, green, blue], axis=-1))


def from_hsv(color: Any) -> Array:
    """RGB of hue, saturation, value; hues outside 0 to 1 fall into the last sixth of the circle, as in Blender."""
    hue, saturation, value = separate(color)
    hue = np.where((hue < 0) | (hue > 1), (5.0 + hue * 6.0 - np.floor(hue * 6.0)) / 6.0, hue)
    return ((make_hue(hue) - 1.0) * spread(saturation) + 1.0) * spread(value)


def from_hsl(color: Any) -> Array:
    """RGB of hue, saturation, lightness."""
    hue, saturation, lightness = separate(color)
    chroma = (1.0 - np.abs(2.0 * lightness - 1.0)) * saturation
    return (make_hue(hue) - 0.5) * spread(chroma) + spread(lightness)


FROM_SPACE: dict[str, Callable[[Any], Any]] = {"RGB": np.asarray, "HSV": from_hsv, "HSL": from_hsl}
TO_SPACE: dict[str, Callable[[Any], Any]] = {"RGB": np.asarray, "HSV": to_hsv, "HSL": to_hsl}


def combine_color(first: Any, second: Any, third: Any, *, mode: str) -> Array:
    """A color of three numbers in a space."""
    return FROM_SPACE[mode](stack(first, second, third))


def separate_color(color: Any, *, mode: str) -> tuple[Any, Any, Any]:
    """The three numbers of a color in a space."""
    return separate(TO_SPACE[mode](color))


def _overlay(t: Any, a: Any, b: Any) -> Any:
    dark = a * (1.0 - t + 2.0 * t * b)
    light = 1.0 - (1.0 - t + 2.0 * t * (1.0 - b)) * (1.0 - a)
    return np.where(a < 0.5, dark, light)


def _divide(t: Any, a: Any, b: Any) -> Any:
    return np.where(b != 0, (1.0 - t) * a + t * divide(a, b), a)


def _dodge(t: Any, a: Any, b: Any) -> Any:
    rest = 1.0 - t * b
    return np.where(a == 0, a, np.where(rest <= 0, 1.0, np.minimum(divide(a, rest), 1.0)))


def _burn(t: Any, a: Any, b: Any) -> Any:
    rest = 1.0 - t + t * b
    return np.where(rest <= 0, 0.0, saturate(1.0 - divide(1.0 - a, rest)))


def _soft_light(t: Any, a: Any, b: Any) -> Any:
    screen = 1.0 - (1.0 - b) * (1.0 - a)
    return (1.0 - t) * a + t * ((1.0 - a) * b * a + a * screen)


def _replace(color: Any, other: Any, components: tuple[int, ...]) -> Array:
    """Return `color` with some of its hue, saturation and value (components 0 to 2) taken from `other`."""
    first, second = to_hsv(color), to_hsv(other)
    return from_hsv(np.where(np.isin(np.arange(3), components), second, first))


def _is_grey(color: Any) -> Array:
    return spread(to_hsv(color)[..., 1] == 0) != 0


def _saturation(t: Any, a: Any, b: Any) -> Any:
    first, second = to_hsv(a), to_hsv(b)
    blended = from_hsv(np.where(np.arange(3) == 1, mix(first, second, t), first))
    return np.where(_is_grey(a), a, blended)


def _value(t: Any, a: Any, b: Any) -> Any:
    first, second = to_hsv(a), to_hsv(b)
    return from_hsv(np.where(np.arange(3) == 2, mix(first, second, t), first))


BLENDS: dict[str, Callable[[Any, Any, Any], Any]] = {
    "MIX": lambda t, a, b: mix(a, b, t),
    "DARKEN": lambda t, a, b: mix(a, np.minimum(a, b), t),
    "MULTIPLY": lambda t, a, b: mix(a, a * b, t),
    "BURN": _burn,
    "LIGHTEN": lambda t, a, b: mix(a, np.maximum(a, b), t),
    "SCREEN": lambda t, a, b: 1.0 - (1.0 - t + t * (1.0 - b)) * (1.0 - a),
    "DODGE": _dodge,
    "ADD": lambda t, a, b: a + b * t,
    "OVERLAY": _overlay,
    "SOFT_LIGHT": _soft_light,
    "LINEAR_LIGHT": lambda t, a, b: a + t * (2.0 * b - 1.0),
    "DIFFERENCE": lambda t, a, b: mix(a, np.abs(a - b), t),
    "EXCLUSION": lambda t, a, b: np.maximum(mix(a, a + b - 2.0 * a * b, t), 0.0),
    "SUBTRACT": lambda t, a, b: a - b * t,
    "DIVIDE": _divide,
    "HUE": lambda t, a, b: np.where(_is_grey(b), a, mix(a, _replace(a, b, (0,)), t)),
    "SATURATION": _saturation,
    "COLOR": lambda t, a, b: np.where(_is_grey(b), a, mix(a, _replace(a, b, (0, 1)), t)),
    "VALUE": _value,
}


def mix_colors(
    factor: Any, a: Any, b: Any, *, blend_type: str, clamp_factor: bool = True, clamp_result: bool = False
) -> Array:
    """One of BLENDS."""
    factor = spread(saturate(factor) if clamp_factor else factor)
    blended = BLENDS[blend_type](factor, *np.broadcast_arrays(np.asarray(a, float), np.asarray(b, float)))
    return saturate(blended) if clamp_result else blended


def mix_colors_of_old(factor: Any, a: Any, b: Any, *, blend_type: str, use_clamp: bool) -> Array:
    """Mix RGB, the node before Mix."""
    return mix_colors(factor, a, b, blend_type=blend_type, clamp_result=use_clamp)


def adjust_hue(hue: Any, saturation: Any, value: Any, factor: Any, color: Any) -> Array:
    """Turn the hue by (hue - 1/2) of a circle, scale saturation and value, blend with the color as it was."""
    first, second, third = separate(to_hsv(color))
    turned = first + hue + 0.5
    turned = turned - np.floor(turned)
    adjusted = from_hsv(stack(turned, saturate(second * saturation), third * value))
    return np.maximum(mix(color, adjusted, spread(factor)), 0.0)


def adjust_brightness(color: Any, brightness: Any, contrast: Any) -> Array:
    """(1 + contrast) color + brightness - contrast / 2, not below 0."""
    return np.maximum((1.0 + spread(contrast)) * color + spread(brightness) - spread(contrast) / 2.0, 0.0)


def apply_gamma(color: Any, gamma: Any) -> Array:
    """color ** gamma; parts of 0 or less stay, and gamma 0 gives white."""
    color, gamma = np.broadcast_arrays(np.asarray(color, float), spread(gamma))
    raised = np.where(color > 0, np.power(np.where(color > 0, color, 1.0), gamma), color)
    return np.where(gamma == 0, 1.0, raised)


def invert(factor: Any, color: Any) -> Array:
    """factor (1 - color) + (1 - factor) color."""
    return mix(color, 1.0 - np.asarray(color), spread(factor))


_PARTS = ("Red", "Green", "Blue")

OPERATIONS = {
    "COMBINE_COLOR": Operation(combine_color, _PARTS, ("Color",), ("mode",)),
    "SEPARATE_COLOR": Operation(separate_color, ("Color",), _PARTS, ("mode",)),
    "COMBRGB": Operation(stack, ("R", "G", "B"), ("Image",)),
    "SEPRGB": Operation(separate, ("Image",), ("R", "G", "B")),
    "COMBHSV": Operation(lambda h, s, v: from_hsv(stack(h, s, v)), ("H", "S", "V"), ("Color",)),
    "SEPHSV": Operation(lambda color: separate(to_hsv(color)), ("Color",), ("H", "S", "V")),
    "MIX Result_Color": Operation(
        mix_colors,
        ("Factor_Float", "A_Color", "B_Color"),
        ("Result_Color",),
        ("blend_type", "clamp_factor", "clamp_result"),
        choices={"blend_type": BLENDS},
    ),
    "MIX_RGB": Operation(
        mix_colors_of_old,
        ("Fac", "Color1", "Color2"),
        ("Color",),
        ("blend_type", "use_clamp"),
        choices={"blend_type": BLENDS},
    ),
    "HUE_SAT": Operation(adjust_hue, ("Hue", "Saturation", "Value", "Fac", "Color"), ("Color",)),
    "BRIGHTCONTRAST": Operation(adjust_brightness, ("Color", "Bright", "Contrast"), ("Color",)),
    "GAMMA": Operation(apply_gamma, ("Color", "Gamma"), ("Color",)),
    "INVERT": Operation(invert, ("Fac", "Color"), ("Color",)),
}
