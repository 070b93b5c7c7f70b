"""When a render is done: at a number of samples, at an error, or when its time is over, whichever comes first.

The error is looked at after fixed numbers of samples, so the picture is the same for any number of workers and any
block size; only a time limit ends where the clock says, at the end of a sweep.
"""

from __future__ import annotations

import time
from typing import Literal

from raytracer.film.film import Film
from raytracer.integrator.settings import Settings

EndedBy = Literal["samples", "error", "time", "cancelled"]

# With fewer samples, rare light may have been missed everywhere, and the error seems small.
FEWEST_SAMPLES = 16
# The error is told anew after 5% more samples: less often than it changes, which makes a lucky moment less likely.
LOOK_GROWTH = 1.05
# How the error falls with the number of samples, as c n^-p: what the remaining time is told from.
USUAL_POWER = 0.6


class Ending:
    """Knows when a film is done.

    sweeps : the most of the film
    started : when tracing began, by `time.perf_counter`, unless `begin` knows better
    done : sweeps that the film had before
    """

    def __init__(self, settings: Settings, sweeps: int, started: float, done: int = 0) -> None:
        self._settings = settings
        self.sweeps = self._expected = sweeps
        self._started, self._done = started, done
        self._has_begun = False
        self._share = 0.0
        self._next_look = round_up(settings.min_samples or FEWEST_SAMPLES)
        self._plan_look(done - 1)
        self._looks_first = self._next_look == done
        self._plan_look(done)

    def begin(self, seconds: float) -> None:
        """Take note, by the first call, of how long the block took that is there now: before it was no tracing, but
        trees and tables, which no further sweep takes the time of."""
        if not self._has_begun:
            self._started = max(self._started, time.perf_counter() - seconds)
        self._has_begun = True

    def find_first(self, film: Film) -> EndedBy | None:
        """Return why a film that goes on is done as it is, or None; called before its first sweep.

        Where an error has ended it, or would have, more samples would make it another picture than one in one go.
        """
        error = self._settings.error
        if error is None or not self._looks_first or film.ahead:
            return None
        return "error" if film.error <= error else None

    def find(self, film: Film, is_amid: bool = False) -> EndedBy | None:
        """Return why a film with `film.samples` finished sweeps is done, or None; called after each sweep.

        is_amid : True where the next sweep has been traced together with this one, and takes no more time
        """
        if self._settings.error is not None and self._reaches_error(film, self._settings.error):
            return "error"
        if film.samples >= self.sweeps:
            return "samples"
        return "time" if not is_amid and self._is_late(film.samples - self._done) else None

    def _reaches_error(self, film: Film, target: float) -> bool:
        if film.samples < self._next_look:
            return False
        error = film.error
        self._plan_look(film.samples)
        # No more times than there are sweeps, so that no power is too large for a float.
        needed = film.samples * min(error / target, float(self.sweeps)) ** (1.0 / USUAL_POWER)
        self._expected = int(min(max(needed, film.samples), self.sweeps))
        return error <= target

    def _plan_look(self, done: int) -> None:
        while self._next_look <= done:
            self._next_look = round_up(max(self._next_look + 2, int(self._next_look * LOOK_GROWTH)))

    def _is_late(self, done: int) -> bool:
        """True where another sweep, after those that this render has `done`, would take longer than there is time."""
        seconds = self._settings.seconds
        if seconds is None:
            return False
        return (time.perf_counter() - self._started) * (done + 1) / done > seconds

    def estimate_share(self, done: float) -> float:
        """Return the share of all work that is done after so many sweeps, which never falls."""
        share = min(done / self._expected, 1.0)
        if self._settings.seconds is not None:
            share = max(share, min((time.perf_counter() - self._started) / self._settings.seconds, 1.0))
        self._share = max(self._share, share)
        return self._share


def round_up(samples: int) -> int:
    """Return the next even number of samples: both replications have as many."""
    return samples + samples % 2
