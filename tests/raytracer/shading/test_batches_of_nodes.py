"""What nodes answer for many points is what they answer for each alone, whichever inputs vary: a number or a vector is
constant where nothing is linked, or where what is linked was folded, and the others may vary beside it."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from raytracer.shading.evaluate import OPERATIONS
from raytracer.shading.nodes.arithmetic import MATH, VECTOR_OPERATIONS
from raytracer.shading.nodes.cells import VORONOI_FEATURES
from raytracer.shading.nodes.color import BLENDS

# Inputs that are vectors or colors.
VECTORS = {
    *("Vector", "Vector_001", "Vector_002", "Color", "Color1", "Color2", "Mortar", "Location", "Rotation"),
    *("Center", "Axis", "A_Color", "B_Color", "A_Vector", "B_Vector", "Orientation 3D", "Normal"),
}
NOISES = ("FBM", "MULTIFRACTAL", "HETERO_TERRAIN", "HYBRID_MULTIFRACTAL", "RIDGED_MULTIFRACTAL")
DIMENSIONS = ("1D", "2D", "3D", "4D")
BANDS, RINGS = {"wave_type": "BANDS"}, {"wave_type": "RINGS"}
OF_WAVES = {"bands_direction": "X", "rings_direction": "SPHERICAL", "wave_profile": "SAW"}
OF_BRICKS = {"offset": 0.5, "offset_frequency": 2, "squash": 0.8, "squash_frequency": 2}
OF_VORONOI = {"distance": "MINKOWSKI", "normalize": True, "whole": False}

CASES: list[tuple[str, dict[str, Any]]] = [
    *(("TEX_NOISE Fac", {"noise_dimensions": size, "noise_type": "FBM", "normalize": True}) for size in DIMENSIONS),
    *(("TEX_NOISE Fac", {"noise_dimensions": "2D", "noise_type": kind, "normalize": False}) for kind in NOISES),
    ("TEX_NOISE Color", {"noise_dimensions": "4D", "noise_type": "FBM", "normalize": True}),
    ("TEX_WAVE", BANDS | OF_WAVES),
    ("TEX_WAVE", RINGS | OF_WAVES),
    ("TEX_MAGIC", {"turbulence_depth": 3}),
    ("TEX_BRICK", OF_BRICKS),
    ("TEX_CHECKER", {}),
    *(("TEX_GRADIENT", {"gradient_type": kind}) for kind in ("LINEAR", "RADIAL", "SPHERICAL")),
    *(("TEX_WHITE_NOISE", {"noise_dimensions": size}) for size in DIMENSIONS),
    *(
        ("TEX_VORONOI", {"feature": feature, "voronoi_dimensions": size, **OF_VORONOI})
        for feature, size in zip(VORONOI_FEATURES, ("4D", "1D", "2D", "2D", "3D"), strict=True)
    ),
    *(("TEX_GABOR", {"gabor_type": kind}) for kind in ("2D", "3D")),
    *(("MATH", {"operation": name, "use_clamp": False}) for name in MATH),
    *(("VECT_MATH Vector", {"operation": name}) for name in VECTOR_OPERATIONS),
    *(("VECT_MATH Value", {"operation": name}) for name in VECTOR_OPERATIONS),
    ("CLAMP", {"clamp_type": "RANGE"}),
    ("COMBXYZ", {}),
    *(
        ("MIX Result_Color", {"blend_type": blend, "clamp_factor": True, "clamp_result": False})
        for blend in sorted(BLENDS)
    ),
    *(("MIX_RGB", {"blend_type": blend, "use_clamp": False}) for blend in sorted(BLENDS)),
    ("MIX Result_Float", {"clamp_factor": True}),
    *(("MAPPING", {"vector_type": kind}) for kind in ("POINT", "TEXTURE", "VECTOR", "NORMAL")),
    *(
        ("VECTOR_ROTATE", {"rotation_type": kind, "invert": invert})
        for kind, invert in itertools.product(("AXIS_ANGLE", "X_AXIS", "EULER_XYZ"), (False, True))
    ),
    ("ShaderNodeRadialTiling", {"normalize": True}),
    *((name, {}) for name in ("HUE_SAT", "BRIGHTCONTRAST", "GAMMA", "INVERT", "COMBRGB", "COMBHSV")),
    *(("COMBINE_COLOR", {"mode": mode}) for mode in ("RGB", "HSV", "HSL")),
]


def draw_inputs(names: tuple[str, ...], rng: Any, count: int, varying: set[int]) -> list[Any]:
    """Return inputs of a node, (count,) or (count, 3) for those that vary, () or (3,) for others."""
    inputs = []
    for number, name in enumerate(names):
        shape = ((count,) if number in varying else ()) + ((3,) if name in VECTORS or _is_scale(name, names) else ())
        inputs.append(rng.uniform(0.1, 2.5, shape))
    return inputs


def _is_scale(name: str, names: tuple[str, ...]) -> bool:
    """Mapping's Scale has three numbers, others' one."""
    return name == "Scale" and "Location" in names


@np.errstate(all="ignore")
def compute(name: str, inputs: list[Any], settings: dict[str, Any]) -> tuple[Any, ...]:
    found = OPERATIONS[name].compute(*inputs, **settings)
    return found if isinstance(found, tuple) else (found,)


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize(("name", "settings"), CASES, ids=lambda value: value if isinstance(value, str) else "")
def test_each_input_may_vary_alone(name: str, settings: dict[str, Any], count: int) -> None:
    names, rng = OPERATIONS[name].inputs, np.random.default_rng(len(name) + count)
    for varying in [{number} for number in range(len(names))] + [set(range(1, len(names)))]:
        inputs = draw_inputs(names, rng, count, varying)
        found = compute(name, inputs, settings)
        for row in range(count):
            own = [value[row] if number in varying else value for number, value in enumerate(inputs)]
            alone = compute(name, own, settings)
            for output, value, single in zip(OPERATIONS[name].outputs, found, alone, strict=True):
                size = np.shape(single)
                assert np.shape(value) in (size, (1, *size), (count, *size)), (names, varying, output)
                whole = np.broadcast_to(value, (count, *size))
                np.testing.assert_allclose(whole[row], single, rtol=1e-12, atol=1e-12, err_msg=f"{varying} {output}")
