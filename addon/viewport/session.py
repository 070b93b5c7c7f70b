"""One region in Rendered shading: what it was told to draw last, and what it has so far.

The renderer is a process of its own (`raytracer.rendering.live`): Blender only extracts what changed, says where it
looks from, and looks at pictures when they come. Nothing here draws or needs a window.
"""

from __future__ import annotations

import math
import pickle
import weakref
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

from raytracer.film.error import format_error
from raytracer.processes.child import describe_error
from raytracer.processes.python import print_traceback
from raytracer.rendering.progressive import Picture, Target

from ..extract.kept import Kept, read_changes
from ..extract.scene import extract_scene
from ..properties import settings_keywords
from . import pool
from .views import EmptyBorderError, read_view

# The most camera rays traced at a time: a new job waits for as many at most.
BLOCK_SIZE = 1 << 15
# What the viewport has its own of, says elsewhere, or does not follow: it goes on to the last of its samples.
NOT_OF_VIEWPORTS = ("samples", "workers", "precision", "error", "min_samples", "seconds")


class Session:
    """One region's renderer."""

    def __init__(self) -> None:
        self.is_closed = False
        self._live = pool.take()
        self._kept = Kept()
        self._depsgraph = 0
        self._asked: bytes | None = None
        self._scene_error = self._view_error = ""
        _sessions.add(self)

    def update(self, depsgraph: Any, space: Any) -> None:
        """Take the scene as it is now; called after every change."""
        if not self._live.is_running:
            self._renew()
        changes = read_changes(depsgraph) if depsgraph.as_pointer() == self._depsgraph else None
        self._depsgraph = depsgraph.as_pointer()
        if changes is not None and changes.is_view_only:
            return
        self._kept.changes = changes
        try:
            extraction = extract_scene(depsgraph, space=space, kept=self._kept)
        except Exception as error:
            self._scene_error = explain(error)
            self.distrust()
            return
        if self._live.set_scene(extraction.scene) or self._scene_error:
            self._asked = None
        self._scene_error = ""

    def _renew(self) -> None:
        """Take another process for one that ended."""
        self._live.close()
        self._live = pool.take()
        self._asked = None
        self.distrust()

    def distrust(self) -> None:
        """Take the next change for a change of anything: what happened is not announced."""
        self._depsgraph = 0

    def look(self, region: Any, region_data: Any, space: Any, depsgraph: Any, pixel_size: int) -> None:
        """Take the view as it is now; what is being drawn goes on if it is the same. Called at every redraw.

        The settings are those of the original scene: a script that changes them tags nothing for evaluation.
        """
        scene = depsgraph.scene
        self._view_error = ""
        try:
            target = make_target(read_view(region, region_data, space, depsgraph.scene_eval), scene, pixel_size)
        except EmptyBorderError:
            return
        except Exception as error:
            self._view_error = explain(error)
            return
        precision = scene.reference_raytracer.precision.lower()
        asked = pickle.dumps((target, precision))
        if asked != self._asked and not self._scene_error:
            self._asked = asked
            self._live.draw(replace(target, workers=share_workers(scene, self, _sessions)), precision)

    @property
    def is_drawing(self) -> bool:
        """True while the process draws, or will with the next redraw."""
        return not (self.is_closed or self._scene_error) and (self._asked is None or self._live.is_drawing)

    @property
    def has_news(self) -> bool:
        """True where there is something to show that `read_picture` has not returned."""
        return self._live.has_news

    def read_picture(self) -> Picture | None:
        """Return the newest picture, or None if there is no newer one than last time."""
        return self._live.read_picture()

    @property
    def status(self) -> str:
        """A line for the user."""
        report = self._live.report
        error = self._scene_error or self._view_error or (report.error if report else "")
        if error:
            return f"Error: {error}"
        picture = report.picture if report else None
        return describe_picture(picture) if picture else "Starting"

    def close(self) -> None:
        """Leave the process to others; may be called again."""
        if not self.is_closed:
            self.is_closed = True
            _sessions.discard(self)
            pool.give_back(self._live)


def describe_picture(picture: Picture) -> str:
    """Return how far a picture is, and how wrong as far as that is known."""
    done = f"Sample {picture.samples}/{picture.total}"
    return f"{done} | error {format_error(picture.error)}" if math.isfinite(picture.error) else done


_sessions: weakref.WeakSet[Session] = weakref.WeakSet()


def share_workers(scene: Any, session: Session, sessions: Iterable[Session]) -> int:
    """Return a session's even share, one at least, of a scene's workers among the sessions that draw.

    It holds until the session draws something else: to begin anew for a change of shares would cost what is there.
    """
    others = sum(other.is_drawing for other in sessions if other is not session)
    return max(1, int(settings_keywords(scene)["workers"]) // (1 + others))


def explain(error: Exception) -> str:
    """Return a sentence for the user, and print where it happened if it should not have."""
    if not isinstance(error, ValueError):
        print_traceback(error)
    return describe_error(error)


def make_target(view: Any, scene: Any, pixel_size: int) -> Target:
    """Return what to draw of a view, by the scene's settings."""
    settings = settings_keywords(scene)
    for name in NOT_OF_VIEWPORTS:
        del settings[name]
    return Target(
        view.camera,
        view.width,
        view.height,
        border=view.border,
        pixel_size=pixel_size,
        samples=scene.reference_raytracer.viewport_samples,
        settings={**settings, "block_size": BLOCK_SIZE},
    )
