"""What decides the bits of a picture, and so which films may go on with one another or be put together.

The scene, the settings that change a sample's value, the size of the whole picture and the version of the ray tracer.
NumPy and the processor are not among them: films of different ones may be merged. Their float64 sums may differ by a
billionth; a float32 picture is the same, or has the next number where a sum is as near as that to the border between
two (of the project's scenes none has).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

# The version of the ray tracer, as in pyproject.toml and in the add-on's manifest.
VERSION = "0.1.0"


class PictureKey:
    """What decides the bits of a picture.

    choices : version, full width and height, interleaving and settings by name, as JSON has them
    scene : SHA-256 of each of the scene's fields, computed when it is first asked for
    """

    def __init__(self, choices: Mapping[str, Any], digest_scene: Callable[[], Mapping[str, str]]) -> None:
        self.choices: dict[str, Any] = json.loads(json.dumps({"version": VERSION, **choices}))
        self._digest_scene = digest_scene

    def __reduce__(self) -> tuple[Any, ...]:
        """Go to other processes with the digests, and without the scene."""
        return restore_key, (self.choices, self.scene)

    @cached_property
    def scene(self) -> dict[str, str]:
        """The digests of the scene's fields."""
        return dict(self._digest_scene())

    @cached_property
    def digest(self) -> str:
        """SHA-256 of all of it, hexadecimal."""
        content = json.dumps({"choices": self.choices, "scene": self.scene}, sort_keys=True)
        return hashlib.sha256(content.encode()).hexdigest()


def restore_key(choices: Mapping[str, Any], scene: Mapping[str, str]) -> PictureKey:
    """Return the key that a file tells of."""
    return PictureKey(choices, lambda: scene)


def describe_difference(found: PictureKey, expected: PictureKey) -> str:
    """Return what tells two pictures apart, for a sentence, or nothing where they are the same.

    Examples
    --------
    >>> one, other = (PictureKey({"seed": seed}, dict) for seed in (0, 1))
    >>> describe_difference(one, other)
    'seed is 0, not 1'
    """
    if found is expected:
        return ""
    names = dict.fromkeys((*found.choices, *expected.choices))
    differing = [name for name in names if found.choices.get(name) != expected.choices.get(name)]
    values = [f"{name} is {found.choices.get(name)}, not {expected.choices.get(name)}" for name in differing]
    if values:
        return ", ".join(values)
    fields = dict.fromkeys((*found.scene, *expected.scene))
    others = [name for name in fields if found.scene.get(name) != expected.scene.get(name)]
    return f"the scene differs in its {', '.join(others)}" if others else ""
