"""What fills space: media that absorb, scatter and emit, and the voxel grids that their programs read.

A medium has an absorption a, a scattering s (their sum is the extinction) and an emission e at each point, per metre:
along a ray dL/dt = -(a + s) L + e + s (what its phase function sends there of the light around).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from raytracer.arrays.checks import as_array, require_choice, require_finite
from raytracer.scene.fields import make_records, set_array, set_color, set_field, set_light, set_number
from raytracer.scene.programs import Program, Register, check_program, check_register

MEDIUM_KINDS = ("absorption", "scatter", "principled", "coefficients", "emission")
PHASES = ("henyey_greenstein", "fournier_forand", "draine", "rayleigh", "mie")
GRID_INTERPOLATIONS = ("linear", "closest", "cubic")

# The colors of a volume closure, what of it is light, which may be below 0, and the range of each of its numbers, as
# Cycles cuts them (kernel/svm/closure.h, kernel/closure/volume*.h).
MEDIUM_COLORS = ("color", "absorption_color", "absorption", "scattering", "blackbody_tint")
MEDIUM_LIGHTS = ("emission",)
MEDIUM_RANGES = {
    **dict.fromkeys(("weight", "density", "temperature", "blackbody"), (0.0, np.inf)),
    "anisotropy": (-0.999, 0.999),
    "ior": (1.0, np.inf),
    "backscatter": (0.0, 0.5),
    "alpha": (0.0, np.inf),
    "diameter": (0.0, np.inf),
}


@dataclass(frozen=True, eq=False)
class VolumeClosure:
    """One part of a medium; each parameter is a constant or a Register of the volume's program.

    kind : one of MEDIUM_KINDS; with the density d,
        absorption    a = d max(1 - color, 0)
        scatter       s = d color
        principled    s = d color, a = d max(1 - color, 0) max(1 - sqrt(absorption_color), 0), emission, black body
        coefficients  absorption, scattering and emission as they are given
        emission      emission as it is given
    weight : factor of all three in the medium's sum (Mix and Add Shader fold into it)
    color, absorption_color : linear RGB
    density : per metre; what an attribute of that name adds is multiplied by the program
    absorption, scattering : linear RGB, per metre, of coefficients
    emission : linear RGB, W / (m^3 sr): a node's strength times its color
    blackbody : share of the light of a black body at `temperature`, kelvin, in the color `blackbody_tint`, that a
        principled closure emits besides (Blackbody Intensity: 0 no emission; see `media.blackbody`)
    phase : one of PHASES, how light is turned by scatter, coefficients and principled (always Henyey and Greenstein's)
    anisotropy : mean cosine g, of henyey_greenstein and draine; alpha : of draine
    ior, backscatter : relative index of refraction, and share of light thrown back, of fournier_forand
    diameter : micrometres, of the drops of mie
    """

    kind: str
    color: Any = 0.8
    weight: Any = 1.0
    density: Any = 1.0
    absorption_color: Any = 0.0
    absorption: Any = 0.0
    scattering: Any = 0.0
    emission: Any = 0.0
    blackbody: Any = 0.0
    blackbody_tint: Any = 1.0
    temperature: Any = 1000.0
    phase: str = "henyey_greenstein"
    anisotropy: Any = 0.0
    ior: Any = 1.33
    backscatter: Any = 0.1
    alpha: Any = 0.5
    diameter: Any = 20.0

    def __post_init__(self) -> None:
        label = f"VolumeClosure {self.kind!r}"
        require_choice(self.kind, MEDIUM_KINDS, "VolumeClosure: kind")
        require_choice(self.phase, PHASES, f"{label}: phase")
        computed = self.registers
        for name in (*MEDIUM_COLORS, *MEDIUM_LIGHTS):
            if name not in computed:
                (set_light if name in MEDIUM_LIGHTS else set_color)(self, name, label)
        for name, (low, high) in MEDIUM_RANGES.items():
            if name not in computed:
                set_number(self, name, low, high, label)

    @property
    def registers(self) -> dict[str, Register]:
        """The parameters that the volume's program computes, by name."""
        return {name: value for name, value in vars(self).items() if isinstance(value, Register)}


@dataclass(frozen=True, eq=False)
class Volume:
    """What fills a closed mesh, or the world: a sum of weighted closures.

    Where volumes overlap, their media add up; the world's is everywhere.

    program : computes the parameters that are Registers, at points in space: positions, object and generated
        coordinates, grids and properties of the object are there to read, normals and texture coordinates are not
    """

    closures: Sequence[VolumeClosure] = ()
    program: Program | None = None

    def __post_init__(self) -> None:
        check_program(self.program, "Volume: program")
        set_field(self, "closures", make_records(self.closures, VolumeClosure, "Volume: closures"))
        for closure in self.closures:
            for name, register in closure.registers.items():
                check_register(register, self.program, f"Volume: {closure.kind}: {name}")


def check_volume(value: Any, label: str) -> None:
    """Raise ValueError if `value` is neither a Volume nor None."""
    if value is not None and not isinstance(value, Volume):
        raise ValueError(f"{label}: expected a Volume or None, got {type(value).__name__}")


@dataclass(frozen=True, eq=False)
class Grid:
    """Values on a lattice of voxels, which programs of volumes read like an attribute of the mesh that they belong to.

    values : (x, y, z), (x, y, z, 3), or (x, y, z, 4) with alpha, float32; that of voxel (i, j, k) is the value at the
        point (i, j, k) of index space, and 0 lies all around
    object_from_index : (4, 4) float64, affine, from index space to the object space of the mesh
    interpolation : one of GRID_INTERPOLATIONS, between the points

    Examples
    --------
    >>> import numpy as np
    >>> Grid(np.ones((4, 4, 4)), np.diag([0.5, 0.5, 0.5, 1.0])).values.dtype.name
    'float32'
    """

    values: Any
    object_from_index: Any
    interpolation: str = "linear"

    def __post_init__(self) -> None:
        shape: tuple[str | int, ...] = ("x", "y", "z")
        if np.ndim(self.values) == 4:
            shape += (4 if np.shape(self.values)[3] == 4 else 3,)
        values = as_array(self.values, np.float32, shape, "Grid: values")
        require_finite(values, "Grid: values")
        if 0 in values.shape:
            raise ValueError(f"Grid: values: expected one voxel at least, got shape {values.shape}")
        set_field(self, "values", values)
        matrix = set_array(self, "object_from_index", np.float64, (4, 4), "Grid")
        if (matrix[3] != (0.0, 0.0, 0.0, 1.0)).any() or not abs(np.linalg.det(matrix)) > 0:
            raise ValueError(
                f"Grid: object_from_index: expected an affine matrix that can be inverted, got {matrix.tolist()}"
            )
        require_choice(self.interpolation, GRID_INTERPOLATIONS, "Grid: interpolation")
