"""The passes of a film: how many channels each has, and what it holds where nothing was hit.

`integrator/first_surface.py` and `contributions.py` fill them, `loop.add_direct_light` the light that is sampled; what
Blender calls and stores them as is the add-on's `passes.py`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Pass:
    """What a pass holds.

    channels : numbers per pixel
    from_centre : True where the value is that of the ray through the pixel's centre, not a mean over samples
    miss : what each channel holds where that ray hits nothing
    needs_light : True where it takes more than the first surface to know it
    is_derived : True where it is no path's to say: it tells of the samples of other passes
    color : the pass of a surface's color that this one, of light, is divided by
    exposed : True for light, which the film's exposure makes brighter
    matte : one of MATTES, whose table of coverage this pass shows two slots of
    is_index : True where values are names of things, of which no two can be averaged or compared by size
    """

    channels: int
    from_centre: bool = False
    miss: float = 0.0
    needs_light: bool = False
    is_derived: bool = False
    color: str = ""
    exposed: bool = False
    matte: str = ""
    is_index: bool = False


# The parts of a BSDF that light is split by.
LIGHT_PARTS = ("Diffuse", "Glossy", "Transmission")


def light_pass(part: str, way: str) -> str:
    """Return the name of the pass of a part: way is 'Direct', 'Indirect' or 'Color'."""
    return f"{part} {way}"


# What media scatter to the camera, of one more ray and of all that comes later.
VOLUME_DIRECT, VOLUME_INDIRECT = "Volume Direct", "Volume Indirect"

# What Cryptomatte tells apart, and the most passes of each.
MATTES = ("Object", "Material", "Asset")
MOST_MATTES = 8


def matte_pass(kind: str, number: int) -> str:
    """Return the name of a pass of Cryptomatte: the things that cover most are in number 0, two in each."""
    return f"Crypto{kind}{number:02}"


PASSES = {
    "Combined": Pass(4, needs_light=True, exposed=True),  # linear RGB, already multiplied by alpha (premultiplied)
    "Depth": Pass(1, from_centre=True, miss=1e10),  # metres along the camera's viewing axis
    "Position": Pass(3, from_centre=True),  # metres, world
    "Vector": Pass(4, from_centre=True),  # pixels, from the frame before and to the next (`surfaces.screen_motion`)
    "Normal": Pass(3),  # shading normal, world, towards the ray
    "UV": Pass(3),  # u, v, 1; 0 on what has no uvs
    "Object Index": Pass(1, from_centre=True, is_index=True),
    "Material Index": Pass(1, from_centre=True, is_index=True),
    **{light_pass(part, "Color"): Pass(3, needs_light=True) for part in LIGHT_PARTS},
    **{
        light_pass(part, way): Pass(3, needs_light=True, color=light_pass(part, "Color"), exposed=True)
        for part in LIGHT_PARTS
        for way in ("Direct", "Indirect")
    },
    **{name: Pass(3, needs_light=True, exposed=True) for name in (VOLUME_DIRECT, VOLUME_INDIRECT)},
    "Environment": Pass(3, needs_light=True, exposed=True),  # the world as it is seen straight
    "Mist": Pass(1, miss=1.0),  # 0 near the camera to 1 in the distance
    **{matte_pass(kind, number): Pass(4, matte=kind) for kind in MATTES for number in range(MOST_MATTES)},
    "Emission": Pass(3, needs_light=True, exposed=True),
    "Ambient Occlusion": Pass(3, needs_light=True),  # share of what is around that is open
    "Shadow": Pass(3, needs_light=True),  # share of the direct light that reaches the surface
    "Denoising Normal": Pass(3, needs_light=True),  # camera space, of what is seen, in mirrors too
    "Denoising Albedo": Pass(3, needs_light=True),
    "Denoising Depth": Pass(1, needs_light=True),
    # The light of shadow catchers, with all else over without: a factor of the footage behind the picture. Where it is
    # asked for, Combined shows no shadows itself, as in Cycles.
    "Shadow Catcher": Pass(3, needs_light=True, is_derived=True),
    "Error": Pass(
        1, needs_light=True, is_derived=True, exposed=True
    ),  # standard error of Combined, the root mean square of R, G, B
    "Sample Count": Pass(1, is_derived=True),
}


# What begins the names of passes that a scene names itself, values and colors that its shaders write (AOVs), and what
# they hold. Of a color, alpha counts the surfaces that have written it.
AOV_VALUE, AOV_COLOR = "AOV Value ", "AOV Color "
LIGHT_GROUP = "Combined_"  # the light of a group alone
NAMED = {AOV_VALUE: Pass(1), AOV_COLOR: Pass(4), LIGHT_GROUP: Pass(3, needs_light=True, exposed=True)}


# What denoisers take.
GUIDES = ("Denoising Normal", "Denoising Albedo", "Denoising Depth")


# What is told from the samples of Combined.
MADE_OF_COMBINED = ("Error", "Shadow Catcher")


# Kept beside Combined where a scene has shadow catchers, which then is what is seen in front of them. Of the paths that
# met one: what they saw (3), what they would see where there is nothing but catchers (3), how much of that is opaque
# (1), and the background behind it all with its alpha (4).
CAUGHT = "Caught"


# Beside Combined where samples are adaptive: how many casts the path of a sample took.
LENGTH = "Path Length"
# Where narrow lobes reflect: what a sample would have seen of light that its path came near to.
NEAR_MISS = "Near Miss"

HIDDEN = {CAUGHT: Pass(11)}


def find_pass(name: str) -> Pass:
    """Return what a pass holds, one that a scene has named too.

    Raises
    ------
    KeyError
        If no pass can have that name.

    Examples
    --------
    >>> find_pass("AOV Value mask").channels
    1
    """
    found = PASSES.get(name) or HIDDEN.get(name)
    if found is not None:
        return found
    for start, kind in NAMED.items():
        if name.startswith(start) and name != start:
            return kind
    raise KeyError(name)


def is_pass(name: Any) -> bool:
    """True for the name of a pass."""
    is_named = isinstance(name, str) and any(name.startswith(start) and name != start for start in NAMED)
    return is_named or name in PASSES


def list_aovs(names: Iterable[str]) -> tuple[str, ...]:
    """Return those of the passes that shaders write."""
    return tuple(name for name in names if name.startswith((AOV_VALUE, AOV_COLOR)))


def list_light_groups(names: Iterable[str]) -> tuple[str, ...]:
    """Return those of the passes that show the light of a group."""
    return tuple(name for name in names if name.startswith(LIGHT_GROUP))


def find_layer_name(name: str) -> str:
    """Return what a file calls a pass.

    Examples
    --------
    >>> find_layer_name("AOV Color mask"), find_layer_name("Depth")
    ('mask', 'Depth')
    """
    return name.removeprefix(AOV_VALUE).removeprefix(AOV_COLOR)


def select_passes(names: Iterable[str], from_centre: bool) -> tuple[str, ...]:
    """Return those of the passes that come from the pixel's centre, or what the others are made of.

    Examples
    --------
    >>> select_passes(["Depth", "Error", "Normal"], from_centre=False)
    ('Combined', 'Normal')
    """
    made_of: dict[str, None] = {}
    for name in names:
        source = "Combined" if name in MADE_OF_COMBINED else name
        made_of |= dict.fromkeys((source, *filter(None, (find_pass(name).color,))))
    kinds = {name: find_pass(name) for name in made_of}
    return tuple(name for name, kind in kinds.items() if kind.from_centre == from_centre and not kind.is_derived)


def select_mattes(names: Iterable[str]) -> dict[str, int]:
    """Return how many slots the tables of Cryptomatte hold for passes, by kind; none for kinds that are not asked for.

    Examples
    --------
    >>> select_mattes(["CryptoObject00", "CryptoObject01", "Depth"])
    {'Object': 4}
    """
    slots: dict[str, int] = {}
    for name in names:
        kind = find_pass(name).matte
        if kind:
            slots[kind] = max(slots.get(kind, 0), 2 * int(name.removeprefix(f"Crypto{kind}")) + 2)
    return slots


def matte_table(kind: str) -> str:
    """Return the name of the table of a kind among what a film holds."""
    return f"Cryptomatte {kind}"
