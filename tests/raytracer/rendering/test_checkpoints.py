"""Files of films while they are rendered: how often they are written, and what is in them when something breaks."""

from __future__ import annotations

import errno
import itertools
import os
from pathlib import Path

import pytest

import raytracer
from raytracer.processes.workers import WorkerError
from raytracer.rendering import checkpoints
from raytracer.rendering.checkpoints import Checkpoints, render_into
from tests.raytracer.rendering.rendering_fixtures import make_lit_scene, same


@pytest.mark.parametrize(("every", "seconds"), [(10.0, 0.1), (0.0, 0.5), (1.0, 3.0)])
def test_writing_takes_a_twentieth_of_the_time_at_most(monkeypatch, tmp_path, every, seconds) -> None:
    """On a clock that only writing and tracing move: a write takes `seconds`, a block a tenth of one."""
    now, written = [0.0], []

    def write(film: object, path: Path) -> None:
        written.append(now[0])
        now[0] += seconds

    monkeypatch.setattr(checkpoints.time, "monotonic", lambda: now[0])
    monkeypatch.setattr(checkpoints, "save_film", write)
    kept = Checkpoints(None, tmp_path / "film.npz", every, pytest.fail)
    while now[0] < 400.0:
        now[0] += 0.1
        kept.consider()
    assert len(written) > 2
    # The first one comes early where every is 0; a block may end a little late.
    assert (len(written) - 1) * seconds <= 0.05 * 400.0
    assert min(b - a for a, b in itertools.pairwise(written)) >= every
    assert len(written) >= 0.9 * 400.0 / max(every + 0.1 + seconds, 20 * seconds)


@pytest.mark.parametrize("failing", [(1,), (1, 2), (5,), (1, 2, 3, 4, 5)])
def test_only_the_last_write_has_to_succeed(monkeypatch, tmp_path: Path, failing: tuple[int, ...]) -> None:
    """A disk that was full for a moment ended renders of hours, and what was traced since the last write was lost."""
    path, writes, faults = tmp_path / "film.npz", itertools.count(1), []

    def write(film: raytracer.Film, path: Path) -> None:
        if next(writes) in failing:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        raytracer.save_film(film, path)

    monkeypatch.setattr(checkpoints, "save_film", write)
    monkeypatch.setattr(checkpoints, "WRITING_SHARE", 1.0)  # after each of four blocks
    options = {"every": 0.0, "on_fault": faults.append, "block_size": 24}
    if 5 in failing:
        with pytest.raises(OSError, match="No space"):
            render_into(path, make_lit_scene(), 8, 6, 2, **options)
    else:
        film = render_into(path, make_lit_scene(), 8, 6, 2, **options)
        assert same(film, raytracer.load_film(path))
        assert same(film, raytracer.render(make_lit_scene(), 8, 6, 2))
    assert len(faults) == len(set(failing) - {5})
    assert next(writes) == 6


def test_a_film_that_is_worth_more_than_its_file_survives_the_last_write(monkeypatch, tmp_path: Path) -> None:
    def refuse(film: raytracer.Film, path: Path) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    monkeypatch.setattr(checkpoints, "save_film", refuse)
    faults: list[OSError] = []
    film = render_into(
        tmp_path / "film.npz", make_lit_scene(), 8, 6, 2, every=100.0, on_fault=faults.append, must_write=False
    )
    assert (film.samples, len(faults)) == (2, 1)


def test_what_was_traced_until_the_workers_were_lost_is_kept(tmp_path: Path) -> None:
    class Dying:
        def __len__(self) -> int:
            return 1

        def load(self, factory, *arguments) -> None:
            self.function = factory(*arguments)

        def run(self, jobs, is_cancelled):
            for number, job in enumerate(jobs):
                if number == 5:
                    raise WorkerError("a worker process ended unexpectedly")
                yield self.function(job)

    path, settings = tmp_path / "film.npz", {"block_size": 20}
    with pytest.raises(WorkerError):
        render_into(path, make_lit_scene(), 8, 6, 4, workers=Dying(), **settings)
    film = raytracer.load_film(path)
    assert (film.samples, film.ahead) == (1, 32)
    render_into(path, make_lit_scene(), 8, 6, 4, **settings)
    assert same(raytracer.load_film(path), raytracer.render(make_lit_scene(), 8, 6, 4))
