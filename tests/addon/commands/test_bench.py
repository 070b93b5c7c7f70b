"""The benchmark: are lies counted, truths not, rays what they are said to be, numbers where they are looked for?"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import raytracer
from addon.commands.bench import SECTIONS
from addon.commands.command_line import CommandError, build_parser
from raytracer import lecture
from tests import meshes
from tests.benchmarks import (
    ablation,
    peers_formulas,
    ray_sets,
    speed,
    speed_scenes,
    tables,
    timing,
)
from tests.benchmarks.accuracy import Effort, compare_peers, measure_spheres
from tests.benchmarks.noise import SHARES
from tests.benchmarks.peers import Answer, Built, Peer, ask, find_loaders, load_peers
from tests.benchmarks.peers_ours import CERTIFIED, FLOAT64
from tests.benchmarks.run import measure_sections
from tests.benchmarks.truth import bound_rate, find_truth, make_truth, tally
from tests.folders import ROOT

ULP = np.finfo(np.float64).eps
# Three rays hit: alone, at an edge of primitives 4 and 7, at 1/3; the last one misses.
TRUTH = make_truth([Fraction(1), Fraction(2), Fraction(1, 3), None], [(3,), (4, 7), (0,), ()])
INF = np.inf
ACCURACY_KEYS = (
    "scene", "family", "peer", "rays", "false_misses", "false_hits", "wrong_primitives", "dt_median", "dt_p99",
    "dt_max", "bound_violations", "bound_median", "bound_p99", "failures_per_million", "rate_bound_per_million",
    "exact_share", "ns_per_ray",
)  # fmt: skip


def answer(t: Any, primitive: Any, t_error: Any = None) -> Answer:
    return Answer(np.array(t, float), np.array(primitive), None if t_error is None else np.array(t_error, float))


def no_progress(iterable: Any, label: str) -> Any:
    return iterable


# Counting -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("given", "lowest_index", "counts"),
    [
        (answer([1, 2, 1 / 3, INF], [3, 4, 0, -1]), True, (0, 0, 0)),
        (answer([1, 2, 1 / 3, INF], [3, 7, 0, -1]), False, (0, 0, 0)),
        (answer([1, 2, 1 / 3, INF], [3, 7, 0, -1]), True, (0, 0, 1)),
        (answer([1, INF, 1 / 3, INF], [3, -1, 0, -1]), False, (1, 0, 0)),
        (answer([1, 2, 1 / 3, 5], [3, 4, 0, 9]), False, (0, 1, 0)),
        (answer([1, 2, 1 / 3, INF], [4, 3, 3, -1]), False, (0, 0, 3)),
        (answer([INF, INF, INF, 1], [-1, -1, -1, 0]), False, (3, 1, 0)),
    ],
)
def test_tally_counts_every_kind_of_lie(given: Answer, lowest_index: bool, counts: tuple[int, int, int]) -> None:
    numbers = tally(TRUTH, given, lowest_index)
    assert (numbers["false_misses"], numbers["false_hits"], numbers["wrong_primitives"]) == counts
    assert numbers["rays"] == 4


def test_tally_measures_distances_below_an_ulp() -> None:
    # The float64 nearest to 1/3 is 2^-54 / 3 too small: a third of an ulp of 2^-54.
    numbers = tally(TRUTH, answer([1 + 3 * ULP, 2 - ULP, 1 / 3, INF], [3, 4, 0, -1]))
    assert numbers["dt_max"] == 3
    assert numbers["dt_median"] == 0.5
    alone = make_truth([Fraction(1, 3)], [(0,)])
    assert tally(alone, answer([1 / 3], [0]))["dt_max"] == pytest.approx(1 / 3, rel=1e-15)


def test_tally_takes_distances_of_right_primitives_only() -> None:
    numbers = tally(TRUTH, answer([100, 2, 1 / 3, INF], [8, 7, 0, -1]))
    assert numbers["dt_max"] == pytest.approx(1 / 3)
    at_start = make_truth([Fraction(0), Fraction(1)], [(0,), (0,)])
    numbers = tally(at_start, answer([1e-9, 1 + ULP], [0, 0], [1, 2 * ULP]))
    assert (numbers["dt_max"], numbers["bound_p99"], numbers["bound_violations"]) == (1, 2, 0)
    nothing = tally(TRUTH, answer([INF] * 4, [-1] * 4))
    assert nothing["dt_median"] is None


@pytest.mark.parametrize(("bound", "broken"), [(0.0, 1), (2.0**-201, 1), (2.0**-200, 0), (INF, 1), (np.nan, 1)])
def test_tally_counts_bounds_that_do_not_hold_exactly(bound: float, broken: int) -> None:
    truth = make_truth([Fraction(1) + Fraction(1, 2**200)], [(0,)])
    assert tally(truth, answer([1], [0], [bound]))["bound_violations"] == broken
    assert tally(truth, answer([1], [0]))["bound_violations"] is None


def test_tally_of_a_peer_with_fewer_rays_judges_the_first_ones() -> None:
    numbers = tally(TRUTH, answer([1, 2], [3, 3]))
    assert (numbers["rays"], numbers["wrong_primitives"], numbers["false_misses"]) == (2, 1, 0)


def test_rate_of_no_failures_is_bounded_by_three_over_n() -> None:
    assert bound_rate(0, 3000) == {"failures_per_million": 0, "rate_bound_per_million": 1000}
    assert bound_rate(3, 1000) == {"failures_per_million": 3000, "rate_bound_per_million": None}
    # What the rule promises: at that rate, seeing nothing is as rare as 5%.
    assert (1 - 1000e-6) ** 3000 < 0.05


def test_truth_knows_all_primitives_at_an_edge() -> None:
    positions, triangles = meshes.make_quad()
    truth = find_truth(np.array([(0, 0, 2.0), (0.25, 0.1, 2.0)]), np.tile((0, 0, -1.0), (2, 1)), positions[triangles])
    np.testing.assert_array_equal(truth.is_first(np.array([1, 1])), [True, False])
    np.testing.assert_array_equal(truth.is_first(np.array([0, 0])), [True, True])
    np.testing.assert_array_equal(truth.is_first(np.array([-1, -1])), [False, False])


# Rays ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("target", "family", "touched"),
    [
        ("icosphere", "vertex", 5),
        ("icosphere", "edge", 2),
        ("icosphere at 2e5", "vertex", 3),
        ("icosphere at 2e5", "edge", 2),
        ("needle lens", "edge", 2),
        ("grid", "vertical vertex", 1),
    ],
)
def test_aimed_rays_go_exactly_through_vertices_and_edges(target: str, family: str, touched: int) -> None:
    generator = np.random.default_rng(1)
    chosen = next(one for one in ray_sets.make_targets(generator) if one.name == target)
    rays = ray_sets.make_rays(chosen, family, generator, 40)
    assert ray_sets.is_float32(rays.origins).all()
    assert ray_sets.is_float32(rays.directions).all()
    truth = find_truth(rays.origins, rays.directions, chosen.positions[chosen.triangles])
    assert (np.bincount(truth.first >> 32, minlength=len(truth)) >= touched).all()


def test_aiming_exactly_on_too_fine_a_lattice_is_refused() -> None:
    target = ray_sets.make_target("fine", meshes.make_icosphere(1), 2.0**-40, 1.0, ray_sets.start_in_box(0, 0.3), ())
    with pytest.raises(ValueError, match=r"fine, vertex: .* lattice is too fine"):
        ray_sets.make_rays(target, "vertex", np.random.default_rng(0), 10)


def test_all_rays_of_a_seed_are_float32_and_repeat() -> None:
    sets, again = ray_sets.make_ray_sets(3, 20), ray_sets.make_ray_sets(3, 20)
    for one, other in zip(sets, again, strict=True):
        np.testing.assert_array_equal(one.origins, other.origins)
        np.testing.assert_array_equal(one.directions, other.directions)
        for vectors in (one.origins, one.directions, one.target.positions):
            assert ray_sets.is_float32(vectors).all(), one.name


# Peers --------------------------------------------------------------------------------------------------------------


def make_fake(name: str, distort: Any) -> Peer:
    """A peer that asks the certified caster and distorts what it hears."""
    honest = load_peers({CERTIFIED: find_loaders()[CERTIFIED]})[0][0]

    def build(positions: Any, triangles: Any) -> Built:
        inner = honest.build(positions, triangles)
        return Built(inner.prepare, inner.cast, lambda found: distort(*inner.read(found)))

    return Peer(name, "0", build)


def test_a_peer_that_lies_is_counted() -> None:
    generator = np.random.default_rng(0)
    target = next(one for one in ray_sets.make_targets(generator) if one.name == "icosphere")
    rays = ray_sets.make_rays(target, "vertex", generator, 30)
    truth = find_truth(rays.origins, rays.directions, target.positions[target.triangles])
    peers = [
        make_fake("honest", Answer),
        make_fake("blind", lambda t, primitive, error: Answer(np.full_like(t, INF), np.full_like(primitive, -1))),
        make_fake("confused", lambda t, primitive, error: Answer(t, primitive + 700)),
        make_fake("sloppy", lambda t, primitive, error: Answer(t * (1 + 4 * ULP), primitive, error)),
    ]
    honest, blind, confused, sloppy = compare_peers(peers, rays, truth, Effort(30, 32, 1, 0))
    assert tuple(honest) == ACCURACY_KEYS
    assert (honest["failures_per_million"], honest["rate_bound_per_million"]) == (0, 1e5)
    assert blind["false_misses"] == confused["wrong_primitives"] == sloppy["bound_violations"] == 30
    assert honest["bound_violations"] == 0
    assert blind["failures_per_million"] == 1e6


def test_a_missing_peer_is_skipped_with_its_reason() -> None:
    def load(name: str) -> Peer:
        raise ImportError("No module named 'nowhere'")

    peers, skipped = load_peers({"absent": load, "present": lambda name: make_fake(name, Answer)})
    assert [peer.name for peer in peers] == ["present"]
    assert skipped == {"absent": "not installed: No module named 'nowhere'"}


LIBRARIES = ("Embree (Open3D)", "Embree (embreex)", "Mitsuba 3", "trimesh (NumPy)")


@pytest.mark.filterwarnings("default")  # of the libraries themselves
@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow if name in LIBRARIES else ()) for name in find_loaders()]
)
def test_peer_is_asked_and_understood_correctly(name: str) -> None:
    peers, skipped = load_peers({name: find_loaders()[name]})
    if skipped:  # peers are optional; the report names those it had to do without in the same words
        pytest.skip(f"{name}: {skipped[name]}")
    built = peers[0].build(*meshes.make_quad(2.0))
    origins = np.array([(0.5, -0.5, 3), (-0.5, 0.5, 3), (5, 5, 3), (0.5, -0.5, 3)], dtype=np.float64)
    directions = np.array([(0, 0, -2), (0, 0, -4), (0, 0, -1), (0, 0, 1)], dtype=np.float64)
    heard = ask(built, origins, directions)
    np.testing.assert_array_equal(heard.primitive, [0, 1, -1, -1])
    np.testing.assert_allclose(heard.t, [1.5, 0.75, INF, INF], rtol=1e-6)
    if built.occlude:
        short = ask(built, origins, directions, 1.0) if name.startswith("Blender") else None
        assert short is None or list(short.primitive) == [-1, 1, -1, -1]
        built.occlude(built.prepare(origins, directions, 1.0))


def test_cramer_in_its_own_precision_is_the_lectures_formula() -> None:
    generator = np.random.default_rng(5)
    origins, directions, a, b, c = generator.normal(size=(5, 2000, 3))
    ours = peers_formulas.cramer_t(origins, directions, a, b, c)
    np.testing.assert_array_equal(ours, lecture.intersect_triangle(origins, directions, a, b, c).t)
    assert np.isfinite(ours).any()
    narrow = [array.astype(np.float32) for array in (origins, directions, a, b, c)]
    assert peers_formulas.cramer_t(*narrow).dtype == np.float32


# Timing and sections ------------------------------------------------------------------------------------------------


def test_casts_take_turns() -> None:
    calls: list[str] = []
    seconds = timing.take_turns({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, 3)
    assert "".join(calls) == "ab" + "ab" * 3
    assert list(seconds) == ["a", "b"]


def ask_for(**changes: Any) -> argparse.Namespace:
    settings = {"sections": ["accuracy"], "rays": 5, "speed_rays": 64, "rounds": 1, "seed": 0, "large": False}
    pictures = {
        "picture_size": (24, 16),
        "picture_samples": 16,
        "picture_renders": 5,
        "scenes": ("penumbra",),
        "keep": None,
    }
    return argparse.Namespace(**settings | pictures | changes)


def test_numbers_have_their_keys_and_tables_show_them() -> None:
    loaders = {CERTIFIED: find_loaders()[CERTIFIED], "fake": lambda name: make_fake(name, Answer)}
    numbers = measure_sections(ask_for(), loaders, no_progress)
    assert tuple(numbers) == ("machine", "settings", "versions", "skipped", "accuracy")
    assert {row["peer"] for row in numbers["accuracy"]} == {CERTIFIED, "fake"}
    assert all(tuple(row) == ACCURACY_KEYS for row in numbers["accuracy"])
    assert sum(row["bound_violations"] for row in numbers["accuracy"]) == 0
    text = tables.write_tables(json.loads(json.dumps(numbers)) | {"skipped": {"absent": "not installed: gone"}})
    assert "skipped absent: not installed: gone" in text
    assert f"| {CERTIFIED} |" in text
    rows = [line for line in text.splitlines() if line.startswith("|")]
    assert all(line.count("|") in (13, 4) for line in rows), "a cell contains a bar"


def test_sphere_formulas_lose_what_is_known_and_certified_mode_nothing() -> None:
    rows = {(row["scene"], row["peer"]): row for row in measure_spheres(Effort(200, 64, 1, 0), no_progress)}
    afar = "unit sphere from 1e8"
    assert rows[afar, "schoolbook discriminant, float64"]["failures_per_million"] > 1e5
    assert rows[afar, "lecture: point-line distance, float64"]["failures_per_million"] == 0
    for (_, peer), row in rows.items():
        if peer == CERTIFIED:
            assert (row["failures_per_million"], row["bound_violations"]) == (0, 0)


def test_speed_rows_have_their_keys() -> None:
    scene = speed_scenes.show_cornell_box()
    assert len(scene.triangles) == 34
    peers, _ = load_peers({name: find_loaders()[name] for name in (CERTIFIED, FLOAT64)})
    built, seconds = speed.build_all(peers, scene)
    assert list(seconds) == [CERTIFIED, FLOAT64]
    camera = speed_scenes.make_camera_rays(scene, 64)
    rows = speed.time_rays(peers, built, scene, camera, 1)
    assert tuple(rows[0]) == ("scene", "triangles", "family", "peer", "rays", "mrays_per_second")
    rays = ray_sets.make_rays(speed_scenes.make_target(scene), "vertex", np.random.default_rng(0), 50)
    row = speed.compare_cost(built, rays, 1)
    assert row["ratio"] == pytest.approx(row["certified_ns"] / row["float64_ns"])
    assert (row["rays"], row["promised"]) == (50, 30)


def test_command_prints_json_alone() -> None:
    command = [
        sys.executable,
        "-m",
        "addon",
        "bench",
        "--json",
        "--sections",
        "spheres",
        "--rays",
        "4",
        "--rounds",
        "1",
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, done.stderr
    numbers = json.loads(done.stdout)
    assert tuple(numbers) == ("machine", "settings", "versions", "skipped", "spheres")
    assert done.stderr.splitlines() == [f"skipped {name}: {reason}" for name, reason in numbers["skipped"].items()]


@pytest.mark.skipif(os.name == "nt", reason="Windows lets few make links")
def test_command_outside_the_repository_says_so(tmp_path: Path) -> None:
    script = "from addon.commands.bench import run; run(None)"
    (tmp_path / "addon").symlink_to(ROOT / "addon")
    (tmp_path / "raytracer").symlink_to(ROOT / "raytracer")
    done = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert CommandError.__name__ in done.stderr
    assert "run it from there" in done.stderr


def test_command_knows_its_sections(capsys: pytest.CaptureFixture[str]) -> None:
    parsed = build_parser().parse_args(["bench", "--sections", "cost", "speed", "--seed", "7"])
    assert (parsed.sections, parsed.seed, parsed.json) == (["cost", "speed"], 7, False)
    whole = build_parser().parse_args(["bench"])
    assert whole.sections == list(SECTIONS)
    assert (whole.picture_size, whole.picture_samples, whole.picture_renders, whole.scenes) == ((240, 160), 256, 8, ())
    assert whole.keep is None
    with pytest.raises(SystemExit):
        build_parser().parse_args(["bench", "--sections", "taste"])
    assert "bench" in capsys.readouterr().err


@pytest.mark.parametrize("feature", ablation.FEATURES)
def test_an_absent_feature_is_never_called(monkeypatch: pytest.MonkeyPatch, feature: str) -> None:
    monkeypatch.setattr(ablation, "WIDTH", 160)
    monkeypatch.setattr(ablation, "HEIGHT", 120)
    make, settings, stage = ablation.FEATURES[feature]
    for scene, present in ((ablation.make_scene(), False), (make(), True)):
        caster = raytracer.build(scene)
        chosen = settings if present else {}
        calls = ablation.count_calls(lambda s=scene, c=caster, k=chosen: ablation.render(s, c, k), stage)
        assert (calls > 0) == present


def make_equal_error_row() -> dict[str, Any]:
    errors = {name: [0.04, 0.02] for name in SHARES}
    curve = {"samples": [4, 16], "seconds": [1.0, 4.0], "errors": errors, "microseconds": 3.5, "start": 0.25}
    curve |= {"slopes": dict(zip(SHARES, (0.5, 0.5, None), strict=True)), "noise_in_1%": 0.25}
    compared = {"error": 0.012, "ratio": 0.5, "spread": 0.03}
    return {
        "scene": "box",
        "light": "path",
        "process": {"raytracer": 1.5, "Cycles": 0.5},
        "curves": dict.fromkeys(("raytracer", "Cycles", "Cycles adaptive"), curve),
        "ratios": {"Cycles": dict.fromkeys(SHARES, compared), "Cycles adaptive": dict.fromkeys(SHARES)},
    }


def test_report_writes_tables_and_plots(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="the plots need matplotlib (the extra `report`)")
    from tests.benchmarks.report import write_report

    loaders = {CERTIFIED: find_loaders()[CERTIFIED]}
    numbers = measure_sections(ask_for(), loaders, no_progress)
    row = {"scene": "box", "triangles": 12, "peer": CERTIFIED}
    numbers["speed"] = [row | {"family": "camera", "rays": 9, "mrays_per_second": 1.5}]
    numbers["builds"] = [row | {"seconds": 0.25}]
    numbers["equal_error"] = [make_equal_error_row()]
    numbers["convergence"] = [
        {"scene": "box", "sampling": "random", "samples": 4, "error": 0.1, "slope": -0.5},
    ]
    written = write_report(numbers, tmp_path / "report")
    names = ["error_against_time.png", "failures.png", "accuracy.md", "speed.png", "speed.md"]
    names += ["equal_error.png", "equal_error.md", "convergence.png", "pictures.md"]
    assert [path.name for path in written] == names
    assert all(path.stat().st_size > 0 for path in written)
    text = (tmp_path / "report" / "equal_error.md").read_text(encoding="utf-8")
    assert "| box | path | without 5% | 0.50 +- 3% at 1.20% | - |" in text
    assert "| all | path | without 5% | 0.50, least 0.50, of 1 | - |" in text
    assert "| box | path | raytracer | 4 to 16 | 4.00% to 2.00% | 0.50 | 0.50 | - | 25% | 3.5 | 0.25 | 1.5 |" in text
    assert "| box, camera | 1.5 |" in (tmp_path / "report" / "speed.md").read_text(encoding="utf-8")
