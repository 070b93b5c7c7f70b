"""Worker processes: order, sharing, errors, and that nothing is left behind."""

import errno
import itertools
import os
import signal
import time

import numpy as np
import pytest

import raytracer
from raytracer.lights.area_lights import unit_axes
from raytracer.processes import child
from raytracer.processes.workers import WorkerError, Workers
from raytracer.scene.camera import Camera
from raytracer.scene.lights import AreaLight
from raytracer.scene.scene import Scene
from raytracer.scene.shapes import Mesh
from tests.portable import count_handles, is_running, kill
from tests.raytracer.processes.worker_fixtures import functions

__all__ = ["functions"]  # a fixture

# What the system says of a process that was killed.
KILLED = "-9" if os.name == "posix" else "15"
needs_sigstop = pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="processes cannot be stopped here")


def test_results_come_in_the_order_of_the_jobs(functions):
    with Workers(2) as workers:
        workers.load(functions.make, "sleep_less_later")
        assert list(workers.run(range(20))) == list(range(20))
        assert list(workers.run([])) == []


def test_arrays_arrive_unchanged_and_read_only(functions):
    array = np.arange(1000.0).reshape(10, 100)
    contents = [array, np.asfortranarray(array), array[::3, ::2], np.zeros((0, 3)), np.array([True]), np.float64(2.5)]
    with Workers(2) as workers:
        workers.load(functions.Look, *contents)
        for got, sent in zip(workers.run(range(len(contents))), contents, strict=True):
            assert np.array_equal(got, sent)
            assert got.dtype == sent.dtype
        # Those that are contiguous lie in the shared file.
        assert next(workers.run(["read-only"])) == [0, 1, 3, 4]
        workers.load(functions.Look, contents[3])  # nothing to share at all
        assert next(workers.run([0])).shape == (0, 3)


def test_workers_can_be_loaded_again(functions):
    with Workers(2) as workers:
        ids = workers.process_ids
        for factor in (2, 3):
            workers.load(functions.Scale, np.arange(5), factor)
            assert list(workers.run(range(5))) == [factor * number for number in range(5)]
        assert workers.process_ids == ids


def test_jobs_are_read_only_a_few_ahead_of_results(functions):
    jobs = itertools.count()
    with Workers(2) as workers:
        workers.load(functions.make, "sleep_less_later")
        results = workers.run(jobs)
        assert [next(results) for _ in range(3)] == [0, 1, 2]
        results.close()
        assert next(jobs) < 3 + 2 * 2 + 1 + 1


def test_cancelling_stops_at_once_and_workers_go_on_living(functions):
    with Workers(2) as workers:
        workers.load(functions.make, "sleep_less_later")
        asked = itertools.count()
        assert len(list(workers.run(range(1000), lambda: next(asked) >= 5))) <= 5
        assert list(workers.run(range(4))) == [0, 1, 2, 3]


def test_closing_ends_processes_that_are_busy(functions):
    with Workers(2) as workers:
        workers.load(functions.make, "sleep_long")
        ids = workers.process_ids
        assert all(is_running(process_id) for process_id in ids)
        assert list(workers.run(range(9), lambda: True)) == []
    assert not any(is_running(process_id) for process_id in ids)


def test_error_in_a_worker_is_one_sentence_with_its_traceback_as_a_note(functions):
    with Workers(2) as workers:
        workers.load(functions.make, "fail")
        with pytest.raises(WorkerError) as caught:
            list(workers.run(range(9)))
        assert str(caught.value) == "a worker process failed: ValueError: job 0 is wrong"
        assert "Traceback" in caught.value.__notes__[0]
        with pytest.raises(WorkerError, match="a worker process failed: ValueError: no such scene"):
            workers.load(functions.fail_to_load)


def test_worker_that_dies_gives_one_error_and_no_hang(functions):
    with Workers(2) as workers:
        workers.load(functions.make, "exit_suddenly")
        ids = workers.process_ids
        with pytest.raises(WorkerError, match=r"^a worker process ended unexpectedly \(exit code 7\)$"):
            list(workers.run(range(100)))
    assert not any(is_running(process_id) for process_id in ids)


def test_killed_workers_give_one_error_and_no_hang(functions):
    with Workers(2) as workers:
        workers.load(functions.make, "sleep_long")
        for process_id in workers.process_ids:
            kill(process_id)
        with pytest.raises(WorkerError, match=rf"^a worker process ended unexpectedly \(exit code {KILLED}\)$"):
            list(workers.run(range(100)))


@pytest.mark.skipif(os.name != "posix", reason="Ctrl-C reaches no process without a console here")
def test_ctrl_c_while_workers_start_is_their_parents_alone(functions, capfd):
    with Workers(1) as workers:
        ids = workers.process_ids
        os.kill(ids[0], signal.SIGINT)  # as a terminal does, to all that it runs
        workers.load(functions.Scale, np.arange(5))
        assert list(workers.run(range(5))) == list(range(5))
        assert workers.process_ids == ids
        assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("killed", [1, 2])
def test_workers_that_were_lost_are_replaced_when_something_is_loaded(functions, killed):
    with Workers(2) as workers:
        workers.load(functions.make, "sleep_less_later")
        assert list(workers.run(range(4))) == list(range(4))
        for process_id in workers.process_ids[:killed]:
            kill(process_id)
        workers.load(functions.make, "sleep_less_later")
        assert list(workers.run(range(20))) == list(range(20))
        assert len(set(workers.process_ids)) == 2
        assert all(is_running(process_id) for process_id in workers.process_ids)


def test_a_pool_whose_lost_worker_cannot_be_replaced_does_not_hang_the_next_time(functions, monkeypatch):
    def refuse(*arguments, **options):
        raise OSError(errno.EAGAIN, "Resource temporarily unavailable")

    with Workers(2) as workers:
        workers.load(functions.make, "sleep_less_later")
        kill(workers.process_ids[0])
        with monkeypatch.context() as patch:
            patch.setattr(child, "start_process", refuse)
            for _ in range(2):
                with pytest.raises(WorkerError, match="cannot be started"):
                    workers.load(functions.make, "sleep_less_later")
        workers.load(functions.make, "sleep_less_later")
        assert list(workers.run(range(20))) == list(range(20))


def test_a_lost_workers_jobs_are_asked_of_another_one(functions):
    with Workers(2) as workers:
        workers.load(functions.make, "sleep_less_later")
        results = workers.run(range(100))
        first = [next(results) for _ in range(10)]
        kill(workers.process_ids[0])
        assert first + list(results) == list(range(100))
        # The one that is left does all of the work from now on.
        assert list(workers.run(range(30))) == list(range(30))


def test_a_job_that_costs_two_workers_is_an_error_and_the_others_go_on(functions):
    with Workers(3) as workers:
        workers.load(functions.make, "exit_suddenly")
        with pytest.raises(WorkerError, match=r"ended unexpectedly \(exit code 7\)$"):
            list(workers.run(range(100)))
        assert list(workers.run([0, 1, 2])) == [0, 1, 2]


def test_what_workers_print_does_not_mix_with_their_answers(functions):
    with Workers(1) as workers:
        workers.load(functions.make, "print_much")
        assert list(workers.run(range(3))) == [0, 1, 2]


def test_nothing_is_written_to_the_temporary_folder(functions, tmp_path, monkeypatch):
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    with Workers(2) as workers:
        for size in (1000, 2000):
            workers.load(functions.Scale, np.arange(float(size)))
            assert list(folder.iterdir()) == []
        assert list(workers.run([1005])) == [1005.0]
    assert list(folder.iterdir()) == []


def test_no_room_for_shared_arrays_is_said(functions, monkeypatch):
    def refuse(ticket):
        raise OSError(28, "No space left on device")

    with Workers(1) as workers:
        monkeypatch.setattr("raytracer.processes.shared_memory._make_memory", refuse)
        with pytest.raises(WorkerError, match=r"^no room for what the workers share: No space left on device$"):
            workers.load(functions.Scale, np.arange(1000.0))
        monkeypatch.undo()
        workers.load(functions.Scale, np.arange(1000.0))
        assert list(workers.run([5])) == [5.0]


def test_want_of_memory_is_said_in_words(functions):
    with Workers(1) as workers:
        workers.load(functions.make, "use_up_memory")
        with pytest.raises(WorkerError, match=r"^a worker process failed: not enough memory; fewer workers need less"):
            list(workers.run([0]))


def test_a_job_that_reads_standard_input_finds_it_empty(functions):
    with Workers(1) as workers:
        workers.load(functions.make, "read_standard_input")
        assert list(workers.run([0, 1])) == ["", ""]


def make_lit_scene() -> Scene:
    """A scene with all that a render keeps something of: a mesh, and a lamp with axes of its own."""
    return Scene(
        meshes=[Mesh([(-2.0, -2.0, -3.0), (2.0, -2.0, -3.0), (0.0, 2.0, -3.0)], [(0, 1, 2)])],
        lights=[AreaLight((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), 30.0)],
        camera=Camera(np.eye(4)),
    )


class Renderer:
    """Renders and tells how many handles its process has open."""

    def __init__(self, scene: Scene) -> None:
        self.film = raytracer.render(scene, 4, 4, samples=1)

    def __call__(self, job: int) -> int:
        return count_handles()


def count_handles_of_renders(renders: int) -> list[int]:
    scene, counts = make_lit_scene(), []
    with Workers(1) as workers:
        for _ in range(renders):
            workers.load(Renderer, scene)
            counts += workers.run([0])
    return counts


# The first few find modules and tables that were not there yet.
SETTLED = 5


def test_handles_do_not_pile_up_in_a_pool_that_is_used_again():
    counts = count_handles_of_renders(40)
    assert max(counts[SETTLED:]) <= max(counts[:SETTLED])


@pytest.mark.slow
def test_handles_stay_the_same_over_1300_renders_on_one_pool():
    counts = count_handles_of_renders(1300)
    assert max(counts[SETTLED:]) <= max(counts[:SETTLED])


def test_axes_of_a_lamp_go_with_it():
    from raytracer.lights import area_lights

    before = len(area_lights._AXES)
    light = make_lit_scene().lights[0]
    assert unit_axes(light) is unit_axes(light)
    assert len(area_lights._AXES) == before + 1
    del light
    assert len(area_lights._AXES) == before


@needs_sigstop
@pytest.mark.parametrize("when", ["at work", "before it is loaded"])
def test_a_stopped_worker_is_noticed_and_others_do_its_work(functions, monkeypatch, when):
    monkeypatch.setattr(child, "SILENCE_SECONDS", 0.5)
    with Workers(2) as workers:
        workers.load(functions.make, "sleep_less_later")
        assert list(workers.run(range(4))) == [0, 1, 2, 3]
        results = workers.run(range(100))
        if when == "at work":
            next(results)
        os.kill(workers.process_ids[0], signal.SIGSTOP)
        if when == "at work":
            assert list(results) == list(range(1, 100))
        else:
            workers.load(functions.make, "sleep_less_later")
            assert list(workers.run(range(9))) == list(range(9))


def test_a_worker_that_is_busy_gives_signs_of_life(functions, monkeypatch):
    monkeypatch.setattr(child, "SILENCE_SECONDS", 3.0)
    with Workers(1) as workers:
        workers.load(functions.make, "sleep_long")
        end = time.perf_counter() + 5.0
        assert list(workers.run([0], lambda: time.perf_counter() > end)) == []
        assert workers._workers[0].child.channel.heard > 3
