"""The noise taken out of a region's picture once it has all its samples, in a thread: nothing of Blender is touched."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np

from raytracer.rendering.progressive import Picture

from ..denoising.process import DenoiseCancelledError, DenoiseError, denoise


class Finishing:
    """What a region shows: pictures as they come, and the last one without its noise where that is wanted."""

    def __init__(self) -> None:
        self._traced: Picture | None = None
        self._asked: Picture | None = None  # the picture that is, or was, without its noise
        # A picture as traced, denoised where it could be, and what there is to say of that.
        self._done: tuple[Picture, Picture | None, str] | None = None
        self._is_closed = False
        self.status = ""

    @property
    def has_news(self) -> bool:
        """True where a picture is done, or cannot be, that `choose` has not seen."""
        return self._done is not None

    def choose(self, picture: Picture | None, is_wanted: bool) -> Picture | None:
        """Return what to show next, or None to stay; called at every redraw.

        picture : a new one as traced, or None
        """
        if picture is not None:
            self._traced, self.status = picture, ""
        traced, chosen = self._traced, picture
        if traced is None:
            return None
        if not is_wanted:
            if self.status:
                self.status, chosen = "", traced
            self._asked = None
        elif traced.samples == traced.total and self._asked is not traced:
            self._begin(traced)
        done, self._done = self._done, None
        if done is not None and is_wanted and done[0] is traced:
            _, denoised, self.status = done
            chosen = chosen if denoised is None else denoised
        return chosen

    def _begin(self, picture: Picture) -> None:
        self._asked = picture
        threading.Thread(target=self._denoise, args=(picture,), name="raytracer-denoise", daemon=True).start()

    def _denoise(self, picture: Picture) -> None:
        denoised = None
        try:
            # The lowest row is first here.
            upright = denoise(np.ascontiguousarray(picture.pixels[::-1]), {}, lambda: self._is_closed)
            denoised, status = replace(picture, pixels=np.ascontiguousarray(upright[::-1])), " | denoised"
        except DenoiseError as error:
            status = f" | not denoised: {error}"
        except MemoryError:
            status = " | not denoised: not enough memory"
        except DenoiseCancelledError:
            return
        self._done = picture, denoised, status

    def close(self) -> None:
        """Want no more."""
        self._is_closed = True
