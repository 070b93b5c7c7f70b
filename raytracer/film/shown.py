"""What pictures show of passes that are made of others: light over color, and shadows over footage."""

from __future__ import annotations

import numpy as np

from raytracer.arrays.types import Floats


def divide_by_color(light: Floats, color: Floats) -> Floats:
    """Return light (n, 3) over the color (n, 3) of the surfaces that have sent it.

    A channel in which they send nothing gets what the others have on average, so that the light stays grey.

    References
    ----------
    Blender, intern/cycles/util/color.h: safe_divide_even_color.
    """
    known = color != 0
    quotient = np.divide(light, color, out=np.zeros_like(light), where=known)
    mean = quotient.sum(axis=1, keepdims=True) / np.maximum(known.sum(axis=1, keepdims=True), 1)
    return np.where(known, quotient, mean)


def find_shadows(caught: Floats) -> Floats:
    """Return the light of shadow catchers (n, 3), with all objects over without, as a factor of the footage behind the
    picture; 1 where there are none.

    Parameters
    ----------
    caught : (n, 11) float64, means of pixels, in the order of CAUGHT

    References
    ----------
    Blender, intern/cycles/kernel/film/read.h: film_calculate_shadow_catcher.
    """
    lit, alone, opacity = caught[:, :3], caught[:, 3:6], caught[:, 6:7]
    factor = np.divide(lit, alone, out=np.ones_like(lit), where=alone != 0)
    return 1.0 + np.clip(opacity, 0.0, 1.0) * (factor - 1.0)


def show_shadows(combined: Floats, caught: Floats) -> Floats:
    """Return what is seen in front of shadow catchers (n, 4) over their shadows over the background.

    What darkens the footage is shown as black of the alpha 1 - mean(factor), with the factor of `find_shadows`;
    brightening, such as of caustics, cannot be shown.

    Parameters
    ----------
    combined, caught : (n, 4), (n, 11) float64, means of pixels, in the order of CAUGHT

    References
    ----------
    Blender, intern/cycles/kernel/film/read.h: film_calculate_shadow_catcher_matte_with_shadow.
    """
    backdrop = caught[:, 7:]
    shadow = 1.0 - np.clip(find_shadows(caught).mean(axis=1), 0.0, 1.0)
    shown = combined.copy()
    shown[:, 3] += (1.0 - combined[:, 3]) * shadow
    return shown + (1.0 - shown[:, 3:]) * backdrop
