"""The render loop, around an integrator that only reports what it was given: its pictures are known exactly."""

import itertools
from dataclasses import dataclass, field

import numpy as np
import pytest

import raytracer
from raytracer.casting.rays import Rays
from raytracer.film.film import Film
from raytracer.film.passes import PASSES
from raytracer.integrator.settings import Settings
from raytracer.processes.workers import Workers
from raytracer.rendering import blocks
from raytracer.rendering import render as render_module
from raytracer.rendering.block_plan import FIRST_BLOCK, LARGE_PICTURE, SMALLEST_BLOCK, USUAL_BLOCK, BlockPlan
from raytracer.rendering.blocks import Block, BlockResult, make_window
from raytracer.rendering.ending import Ending
from raytracer.rendering.render import render
from raytracer.sampling.sobol import SobolSamples
from raytracer.scene.camera import Camera
from raytracer.scene.scene import Scene
from tests.raytracer.rendering.rendering_fixtures import make_lit_scene

CAMERA = Camera(world_from_camera=np.eye(4), projection="orthographic", ortho_scale=16.0)
SCENE = Scene(camera=CAMERA)
WIDTH, HEIGHT = 16, 12


@dataclass
class Recorder:
    """An integrator that notes what it is asked, and returns the ray's position on the film plane in every pass."""

    settings: list[Settings] = field(default_factory=list)
    rays: list[Rays] = field(default_factory=list)
    samples: list[SobolSamples] = field(default_factory=list)
    casts_per_block: int = 1

    def prepare(self, scene, caster, settings, frame, take_part):
        self.settings.append(settings)
        return caster, settings.passes

    def trace(self, integrator, rays, samples):
        caster, names = integrator
        for _ in range(self.casts_per_block):
            caster.any_hit(rays.origins, rays.directions)
        self.rays.append(rays)
        self.samples.append(samples)
        values = np.column_stack([rays.origins[:, :2], samples.uniform_pair(0)])
        return {name: values[:, : PASSES[name].channels] for name in names}

    def offsets(self) -> np.ndarray:
        """(n, 2) distance of every ray from the centre of its pixel, pixels: the film is 1 m per pixel."""
        pixel = np.concatenate([samples.pixel for samples in self.samples])
        position = np.concatenate([rays.origins[:, :2] for rays in self.rays])
        return position - np.column_stack([pixel % WIDTH + 0.5 - WIDTH / 2, pixel // WIDTH + 0.5 - HEIGHT / 2])


class NoCaster:
    """Stands in for a caster: nothing is ever hit."""

    def any_hit(self, origins, directions):
        return np.zeros(len(origins), dtype=bool)


@pytest.fixture
def recorder(monkeypatch):
    recorder = Recorder()
    monkeypatch.setattr(blocks, "prepare", recorder.prepare)
    monkeypatch.setattr(blocks, "trace", recorder.trace)
    return recorder


def render_recorded(samples=4, **keywords):
    return render(SCENE, WIDTH, HEIGHT, samples, caster=NoCaster(), **keywords)


def test_picture_shows_the_film_plane_upright(recorder):
    film = render_recorded(1, filter_width=0.0)
    x, y = film["Combined"][..., 0], film["Combined"][..., 1]
    assert np.array_equal(x, np.tile(np.arange(-7.5, 8), (12, 1)))
    assert np.array_equal(y, np.tile(np.arange(5.5, -6, -1)[:, np.newaxis], (1, 16)))


@pytest.mark.parametrize("block_size", [1, 7, 100, 192, 10**6])
def test_picture_is_the_same_for_any_block_size(recorder, block_size):
    expected = render_recorded(seed=3)["Combined"]
    assert np.array_equal(render_recorded(seed=3, block_size=block_size)["Combined"], expected)


@pytest.mark.parametrize("border", [(0, 0, 16, 12), (3, 2, 10, 11), (15, 0, 16, 1), (0, 11, 16, 12)])
def test_border_is_the_crop_of_the_full_picture(recorder, border):
    x_min, y_min, x_max, y_max = border
    full = render_recorded(passes=("Combined", "Depth"))
    part = render_recorded(passes=("Combined", "Depth"), border=border)
    for name in ("Combined", "Depth"):
        assert np.array_equal(part[name], full[name][HEIGHT - y_max : HEIGHT - y_min, x_min:x_max])
    assert part.statistics.rays == (x_max - x_min) * (y_max - y_min) * 5


def test_another_seed_is_another_picture(recorder):
    assert (render_recorded(seed=1)["Combined"] != render_recorded(seed=2)["Combined"]).any()


def test_first_samples_of_a_longer_render_are_those_of_a_shorter_one(recorder):
    seen = {}
    one_sample_at_a_time = WIDTH * HEIGHT
    render_recorded(
        8,
        block_size=one_sample_at_a_time,
        on_sweep=lambda film, done, total: seen.setdefault(done, film["Combined"]),
    )
    for samples in range(1, 9):
        assert np.array_equal(render_recorded(samples)["Combined"], seen[samples])


def test_small_pictures_take_several_samples_at_a_time(recorder):
    seen = []
    render_recorded(200, block_size=50 * WIDTH * HEIGHT, on_sweep=lambda film, done, total: seen.append((done, total)))
    assert seen == [(50, 200), (100, 200), (150, 200), (200, 200)]
    assert [len(rays) for rays in recorder.rays] == [50 * WIDTH * HEIGHT] * 4


@pytest.mark.parametrize(
    ("fields", "reach"), [({}, 1.5), ({"filter_width": 0.01}, 0.01), ({"pixel_filter": "box"}, 0.5)]
)
def test_rays_fill_the_pixel_filter(recorder, fields, reach):
    render_recorded(64, **fields)
    offsets = recorder.offsets()
    # Positions are differences of numbers up to 8.
    assert np.abs(offsets).max() <= reach + 16 * np.finfo(np.float64).eps
    assert (np.abs(offsets).max(axis=0) > 0.8 * reach).all()
    assert abs(np.corrcoef(offsets.T)[0, 1]) < 5 / np.sqrt(len(offsets))
    # Five standard deviations of the mean, at most those of the uniform distribution, reach / sqrt(3) a sample.
    assert np.abs(offsets.mean(axis=0)).max() < 5 * reach / np.sqrt(3 * len(offsets))


def test_filter_samples_are_independent_of_the_integrators(recorder):
    render_recorded(64)
    offsets = recorder.offsets()
    for dimension in range(4):
        pairs = np.concatenate([samples.uniform_pair(dimension) for samples in recorder.samples])
        for offset, values in itertools.product(offsets.T, pairs.T):
            assert abs(np.corrcoef(offset, values)[0, 1]) < 5 / np.sqrt(len(offsets))


def test_depth_comes_from_the_pixels_centre_and_changes_nothing_else(recorder):
    expected = render_recorded()["Combined"]
    film = render_recorded(passes=("Combined", "Depth"))
    assert np.array_equal(film["Combined"], expected)
    assert np.array_equal(film["Depth"][..., 0], np.tile(np.arange(-7.5, 8), (12, 1)))
    assert [settings.passes for settings in recorder.settings[1:]] == [("Combined",), ("Depth",)]


def test_centre_passes_alone_take_one_ray_per_pixel(recorder):
    calls = []
    film = render_recorded(
        64, passes=("Depth", "Position"), on_sweep=lambda film, done, total: calls.append((done, total))
    )
    assert film.statistics.rays == WIDTH * HEIGHT
    assert calls == [(1, 1)]
    assert not film.cancelled


def test_callbacks_tell_every_pass_and_block(recorder):
    passes, shares = [], []
    film = render_recorded(
        3,
        block_size=100,
        on_sweep=lambda film, done, total: passes.append((film.samples, done, total)),
        on_progress=shares.append,
    )
    assert passes == [(1, 1, 3), (2, 2, 3), (3, 3, 3)]
    assert shares == [(192 * done + part) / 576 for done in range(3) for part in (96, 192)]
    assert (film.samples, film.cancelled) == (3, False)
    assert film.statistics.rays == 576
    assert film.statistics.trace_seconds > 0


def test_cancelling_returns_the_film_so_far(recorder):
    asked = itertools.count()
    film = render_recorded(9, block_size=100, is_cancelled=lambda: next(asked) >= 5, seed=1)
    assert (film.samples, film.cancelled) == (2, True)
    assert film.statistics.rays == 2 * 192 + 96
    # Two samples everywhere and a third in the first block, which is the lower part of the picture.
    two, three = render_recorded(2, seed=1)["Combined"], render_recorded(3, seed=1)["Combined"]
    has_three = np.zeros(192, dtype=bool)
    has_three[:96] = True
    has_three = has_three.reshape(12, 16)[::-1, :, np.newaxis]
    assert np.array_equal(film["Combined"], np.where(has_three, three, two))


def test_cancelling_is_noticed_in_the_middle_of_a_block(recorder):
    """An integrator casts many times for one block; the first cast after the user's Esc ends it."""
    recorder.casts_per_block = 10
    asked = itertools.count()
    film = render_recorded(block_size=WIDTH * HEIGHT, is_cancelled=lambda: next(asked) >= 13)
    assert next(asked) == 14
    assert (film.samples, film.cancelled) == (1, True)


def test_cancelling_before_the_start_returns_an_empty_film(recorder):
    film = render_recorded(is_cancelled=lambda: True)
    assert (film.samples, film.cancelled, film.statistics.rays) == (0, True, 0)
    assert not film["Combined"].any()


def test_scene_without_camera_is_one_clear_error():
    with pytest.raises(ValueError, match=r"^Scene: camera: expected a Camera to render through, got None$"):
        render(Scene(), 4, 4)


@pytest.mark.parametrize(
    ("width", "height", "fields", "message"),
    [
        (0, 4, {}, "render: width: expected a whole number of 1 or more, got 0"),
        (4, 2.5, {}, "render: height: expected a whole number, got 2.5"),
        (2**20, 2**20, {}, r"render: expected a picture of at most 2\^32 pixels"),
        (
            4,
            4,
            {"border": (0, 0, 5, 4)},
            r"border: expected x_max <= 4 and y_max <= 4, the picture's size, got \(0, 0, 5",
        ),
        (4, 4, {"samples": 0}, "Settings: samples"),
    ],
)
def test_sizes_that_do_not_fit_are_named(width, height, fields, message):
    with pytest.raises(ValueError, match=message):
        render(SCENE, width, height, **fields)


def test_what_is_no_scene_and_what_is_no_film_are_refused():
    with pytest.raises(ValueError, match=r"^render: scene: expected a Scene, got str$"):
        render("scene.npz", 4, 4)
    with pytest.raises(ValueError, match=r"^render: film: expected a Film, .*got 'film\.npz'$"):
        render(SCENE, 4, 4, film="film.npz")


def test_unknown_setting_is_refused():
    with pytest.raises(TypeError, match="sample_count"):
        render(SCENE, 4, 4, sample_count=3)


def test_the_last_pixel_of_the_largest_picture_has_its_own_samples():
    view = make_window(SCENE, 2**16, 2**16, Settings(border=(2**16 - 1, 2**16 - 1, 2**16, 2**16)))
    samples, x, y = blocks.locate_pixels(view, blocks.Block(0, 0, 1), 0)
    assert (samples.pixel.tolist(), x.tolist(), y.tolist()) == ([2**32 - 1], [2**16 - 0.5], [2**16 - 0.5])


@pytest.mark.parametrize("interleaving", [0, 1, 2])
def test_picture_is_the_same_for_any_number_of_workers_and_any_block_size(monkeypatch, interleaving):
    monkeypatch.setattr(blocks, "choose_interleaving", lambda pixels, scene: interleaving)
    scene = make_lit_scene()
    settings = {"samples": 3, "passes": ("Combined", "Normal", "Depth"), "seed": 5}
    expected = render(scene, 40, 30, **settings)
    with Workers(2) as workers:
        for block_size in (77, 1200):
            for count in (1, workers):
                film = render(scene, 40, 30, workers=count, block_size=block_size, **settings)
                for name, values in expected.passes.items():
                    assert np.array_equal(film[name], values), (name, block_size, count)
                assert film.statistics.rays == expected.statistics.rays
    assert np.array_equal(render(scene, 40, 30, workers=2, **settings)["Combined"], expected["Combined"])
    part = render(scene, 40, 30, border=(3, 5, 34, 16), **settings)["Combined"]
    assert np.array_equal(part, expected["Combined"][30 - 16 : 30 - 5, 3:34])


def test_cancelling_workers_returns_the_film_so_far_and_they_go_on():
    scene, done = make_lit_scene(), []
    with Workers(2) as workers:
        keywords = {"workers": workers, "block_size": 400, "seed": 1}
        film = render(scene, 40, 30, 10**6, on_progress=done.append, is_cancelled=lambda: len(done) >= 7, **keywords)
        assert (film.samples, film.cancelled) == (2, True)
        assert not render(scene, 40, 30, 1, **keywords).cancelled


def test_stages_are_told_as_they_begin():
    scene, stages = make_lit_scene(), []
    film = render(scene, WIDTH, HEIGHT, 1, on_stage=stages.append)
    assert stages == ["Building", "Tracing"]
    stages.clear()
    same = render(scene, WIDTH, HEIGHT, 1, workers=2, caster=raytracer.build(scene), on_stage=stages.append)
    assert stages == ["Starting 2 workers", "Tracing"]
    np.testing.assert_array_equal(same["Combined"], film["Combined"])


def make_result(block, seconds):
    return BlockResult(block, {}, None, 0, seconds)


def test_plan_covers_every_pixel_of_every_pass_once():
    plan = BlockPlan(pixels=10000, sweeps=3, largest=6000)
    covered = np.zeros((3, 10000), dtype=int)
    for block in plan:
        covered[block.sample, block.start : block.stop] += 1
        plan.observe(make_result(block, 0.0))
    assert (covered == 1).all()


def test_plan_fits_blocks_to_the_time_they_take():
    """At 10 microseconds per ray, two seconds are 200000 rays; at 2 microseconds the largest block is less."""
    for microseconds, size in ((10, 200_000), (2, 524_288), (1000, 131_072)):
        plan = BlockPlan(pixels=10**7, sweeps=1, largest=2**19)
        blocks = []
        for block in plan:
            blocks.append(block.stop - block.start)
            plan.observe(make_result(block, blocks[-1] * microseconds * 1e-6))
        assert 0.99 * FIRST_BLOCK < blocks[0] <= FIRST_BLOCK
        assert 0.99 * SMALLEST_BLOCK < blocks[3] <= SMALLEST_BLOCK
        assert 0.9 * size < blocks[-1] <= size
        assert max(b / a for a, b in itertools.pairwise(blocks)) <= 2.05


@pytest.mark.parametrize(("pixels", "sweeps", "workers"), [(64 * 36, 16, 8), (64 * 36, 64, 3), (10**5, 1, 8)])
def test_plan_has_work_for_all_workers(pixels, sweeps, workers):
    plan = BlockPlan(pixels, sweeps, largest=2**18, workers=workers)
    sizes = [len(block) * block.samples for block in plan]
    assert sum(sizes) == pixels * sweeps
    assert len(sizes) >= workers
    assert max(sizes) <= max(-(-pixels * sweeps // workers), 2**12)
    # The last ones are small: nobody waits long for the one who has begun last.
    assert sizes[-1] <= max(2**12, pixels)


def test_plan_cuts_what_is_left_of_a_pass_evenly():
    plan = BlockPlan(pixels=70000, sweeps=3, largest=50000)
    sizes = []
    for block in plan:
        sizes.append(block.stop - block.start)
        plan.observe(make_result(block, 1e-6 * sizes[-1]))
    assert sizes == [35_000] * 6


def test_plan_leaves_room_beside_a_large_film():
    """However quick its rays are."""
    for pixels, size in ((LARGE_PICTURE - 1, 2**19), (LARGE_PICTURE, USUAL_BLOCK)):
        plan, sizes = BlockPlan(pixels, sweeps=1, largest=2**19), []
        for block in plan:
            sizes.append(len(block))
            plan.observe(make_result(block, 1e-7 * len(block)))
        assert 0.9 * size < max(sizes) <= size


def test_plan_of_short_work_takes_it_whole():
    """A start with small blocks pays where the work is long."""
    assert [block.samples for block in BlockPlan(pixels=10_000, sweeps=26, largest=2**18)] == [26]


def test_plan_learns_nothing_from_the_short_rest_of_a_pass():
    plan = BlockPlan(pixels=100_000, sweeps=2, largest=80_000)
    plan.observe(make_result(Block(0, 90_000, 100_000), 100.0))
    sizes = [block.stop - block.start for block in plan]
    assert sizes[-2:] == [50_000, 50_000]


def test_a_block_of_chosen_pixels_sees_what_the_run_sees():
    scene = make_lit_scene()
    settings = Settings(samples=4, passes=("Combined", "Depth"))
    window = make_window(scene, WIDTH, HEIGHT, settings)
    tracer = blocks.BlockTracer(scene, raytracer.build(scene), window, settings)
    chosen = np.array([0, 1, 5, 17, WIDTH * HEIGHT - 1])
    whole, some = tracer(Block(0, 0, WIDTH * HEIGHT, 2)), tracer(Block(0, 0, 0, 2, chosen))
    rows = np.concatenate([chosen, chosen + WIDTH * HEIGHT])
    np.testing.assert_array_equal(some.values["Combined"], whole.values["Combined"][rows])
    np.testing.assert_array_equal(some.centre_values["Depth"], whole.centre_values["Depth"][chosen])
    films = [Film(WIDTH, HEIGHT, settings.passes) for _ in range(2)]
    for film, result in zip(films, (whole, some), strict=True):
        render_module.add_result(film, result, Ending(settings, 4, started=0.0), ends_sweep=False)
    flat = [film["Combined"][::-1].reshape(-1, 4) for film in films]
    np.testing.assert_array_equal(flat[1][chosen], flat[0][chosen])
    assert not np.delete(flat[1], chosen, axis=0).any()
