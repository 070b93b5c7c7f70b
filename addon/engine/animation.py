"""What an animation keeps from frame to frame: what was read and the trees over it, of all that did not change.

Blender makes everything anew for each frame of a render and announces nothing, so what is read is compared; images of
files are taken to stay as they are. All is let go when the animation ends.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from bpy.app.handlers import persistent

import raytracer

from .. import handlers
from ..extract.kept import Kept

# Any ray: what a caster builds when it is first asked, it builds for this one.
RAY = ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))


@dataclass
class Frames:
    """The frames of one view layer: what the last extraction left, and the last caster."""

    kept: Kept = field(default_factory=lambda: Kept(trusts_files=True))
    caster: raytracer.Caster | None = None

    def build(self, scene: raytracer.Scene, precision: str) -> raytracer.Caster:
        """Return a caster for the next frame, with its trees: built here, they are there for all workers and for the
        frame after."""
        self.caster = raytracer.build(scene, precision, last=self.caster)
        self.caster.closest_hit(*RAY)
        return self.caster


_frames: dict[tuple[int, str], Frames] = {}


def find_frames(engine: Any, depsgraph: Any) -> Frames | None:
    """Return what is kept of the view layer that is being rendered, or None where it is a single picture."""
    if not engine.is_animation:
        return None
    return _frames.setdefault((depsgraph.scene.session_uid, depsgraph.view_layer.name), Frames())


@persistent
def forget(*_: Any) -> None:
    """Let go of all frames."""
    _frames.clear()


def register() -> None:
    """Watch for the end of animations."""
    handlers.join(forget, *handlers.RENDER_ENDS)


def unregister() -> None:
    """Let go of everything and watch no more."""
    forget()
    handlers.leave(forget, *handlers.RENDER_ENDS)
