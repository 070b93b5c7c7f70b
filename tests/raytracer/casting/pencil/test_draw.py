"""Rays that leave one point, drawn on: hits are those of the tree, which are those of brute force, bit for bit."""

from dataclasses import replace

import numpy as np
import pytest

import raytracer
from raytracer.casting import caster as casting_caster
from raytracer.casting.brute_force import offer_all
from raytracer.casting.matrix_form import MatrixForm
from raytracer.casting.pencil.cluster_culling import are_hidden, cull_clusters, project_vertices
from raytracer.casting.pencil.clusters import CLUSTER, make_clusters, place_on_curve
from raytracer.casting.pencil.grids import RANGE_SLACK, PixelGrid, limit_nearness
from raytracer.casting.pencil.jittered_grid import MOST_JITTER, JitteredGrid
from raytracer.casting.pencil.pencil import find_pencil, make_views
from raytracer.casting.pencil.pixel_grid import find_pixel_grid
from raytracer.casting.pencil.strip_grid import LONGEST, STRIP, StripGrid
from raytracer.casting.rays import make_rays
from raytracer.film.pixel_filter import sample_pixel_filter
from tests import meshes
from tests.oracle.judging import assert_same_hits, judge, mesh_scene

WIDE, HIGH = 48, 30


def make_pixels(look, along, across, wide=WIDE, high=HIGH):
    """Directions of a pinhole's pixels, row by row; the middle one looks along `look`."""
    column, row = np.meshgrid(np.arange(wide) - wide // 2, np.arange(high) - high // 2)
    return look + column.reshape(-1, 1) * np.asarray(along) + row.reshape(-1, 1) * np.asarray(across)


def jitter(rng, directions, along, across, pixel_filter, width):
    offset = sample_pixel_filter(rng.random((len(directions), 2)), pixel_filter, width)
    return directions + offset[:, :1] * np.asarray(along) + offset[:, 1:] * np.asarray(across)


def compare(scene, origin, directions, t_min=0.0, t_max=np.inf):
    """Cast by drawing and by the tree; return the hits."""
    caster = raytracer.build(scene)
    assert caster.drawn is not None
    drawing = replace(caster, offer=None, smallest_pencil=0)
    arguments = np.tile(origin, (len(directions), 1)), directions, t_min, t_max
    hits, true = drawing.closest_hit(*arguments), replace(caster, smallest_pencil=None).closest_hit(*arguments)
    assert_same_hits(hits, true)
    np.testing.assert_array_equal(drawing.any_hit(*arguments), true.hit)
    return hits


def compare_ranges(scene, origin, directions):
    """Also with ranges that end, or begin, at hits, or beside them."""
    hits = compare(scene, origin, directions)
    t = np.where(hits.hit, hits.distance, 1.0)
    compare(scene, origin, directions, 0.0, t)
    compare(scene, origin, directions, 0.0, np.nextafter(t, 0))
    compare(scene, origin, directions, t, np.inf)
    compare(scene, origin, directions, np.nextafter(t, np.inf), 2 * t)
    return hits


def place_mesh(mesh, scale, offset):
    return mesh[0] * scale + offset, mesh[1]


def make_scene(rng, name, scale, offset):
    mesh = {
        "plane": lambda: meshes.make_grid(20, 20.0),
        "torus": lambda: meshes.make_torus(40, 20),
        "icosphere": lambda: meshes.make_icosphere(3),
        "soup": lambda: meshes.make_soup(rng, 300),
        "needles": meshes.make_needle_lens,
        "twice": lambda: meshes.join_meshes([meshes.make_torus(16, 10)] * 2),
    }[name]()
    return mesh_scene(place_mesh(mesh, scale, offset))


GRIDS = {
    "regular": None,
    "box": ("box", 1.0),
    "wide box": ("box", 1.9),
    "blackman_harris": ("blackman_harris", 1.5),
    "scattered": ("blackman_harris", 8.0),
}


# Scales and offsets: near, far away, tiny and huge.
PLACES = [(1.0, 0.0), (1.0, 1.5e5), (1.0, 1e6), (1e-6, 0.0), (1e12, 0.0)]
MESHES = ("plane", "torus", "icosphere", "soup", "needles", "twice")


@pytest.mark.parametrize("grid", GRIDS)
@pytest.mark.parametrize("name", MESHES)
def test_pixels_see_what_the_tree_sees(rng, name, grid):
    """Each mesh on each grid, at another place every time."""
    scale, offset = PLACES[(list(GRIDS).index(grid) + MESHES.index(name)) % len(PLACES)]
    scene = make_scene(rng, name, scale, offset)
    positions = scene.meshes[0].positions
    centre, size = positions.mean(axis=0), float(np.ptp(positions, axis=0).max())
    origin = centre + size * np.array([0.13, -0.21, 1.5])
    along, across = np.array([size / WIDE, 0.0, 0.0]), np.array([0.0, size / HIGH, 0.0])
    directions = make_pixels(centre - origin, along, across)
    if GRIDS[grid]:
        directions = jitter(rng, directions, along, across, *GRIDS[grid])
    hits = compare_ranges(scene, origin, directions)
    assert hits.hit.any()
    # From within, from a vertex, from a face.
    corners = positions[scene.meshes[0].triangles]
    for inside in (centre, corners[7, 0], corners[11].mean(axis=0)):
        compare(scene, inside, directions)


@pytest.mark.parametrize("inside", [False, True])
def test_rays_at_vertices_and_edges_of_a_lattice_see_what_the_tree_sees(inside):
    """Pixels at the very vertices, edge middles and diagonals of a plane's cells, which are exact numbers."""
    positions, triangles = meshes.make_grid(16, 16.0)
    scene = mesh_scene((positions, triangles))
    origin = positions.mean(axis=0) + np.array([0.5, 0.25, 0.0625 if inside else 8.0])
    directions = make_pixels(np.array([0.0, 0.0, -origin[2]]), (0.25, 0.0, 0.0), (0.0, 0.25, 0.0))
    hits = compare_ranges(scene, origin, directions)
    exact = judge(raytracer.build(scene), np.tile(origin, (len(directions), 1)), directions)
    np.testing.assert_array_equal(hits.primitive, exact.primitive)


@pytest.mark.parametrize("length", [1e-30, 1e30])
def test_lengths_of_directions_change_nothing_but_units(rng, length):
    scene = mesh_scene(meshes.make_torus(30, 16))
    directions = make_pixels(np.array([0.1, 0.0, -3.0]), (0.08, 0, 0), (0, 0.08, 0))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    hits = compare(scene, np.array([0.2, 0.1, 3.0]), directions * length)
    assert hits.hit.sum() > 300


def test_float64_and_float32_casters_draw_too(rng):
    for precision in ("float64", "float32"):
        caster = raytracer.build(mesh_scene(meshes.make_icosphere(3)), precision)
        origins, directions = (
            np.tile((0.1, 0.2, 3.0), (WIDE * HIGH, 1)),
            make_pixels(np.array([0, 0, -3.0]), (0.04, 0, 0), (0, 0.04, 0)),
        )
        hits = replace(caster, offer=None, smallest_pencil=0).closest_hit(origins, directions)
        true = replace(caster, offer=offer_all, smallest_pencil=None).closest_hit(origins, directions)
        np.testing.assert_array_equal(hits.hit, true.hit)
        np.testing.assert_array_equal(hits.distance, true.distance)


@pytest.mark.parametrize("scale", [1e-130, 1.0, 1e130])
@pytest.mark.parametrize("power", [-200, -40, 0, 70, 200])
@pytest.mark.filterwarnings("error")
def test_directions_of_any_length_in_scenes_of_any_size_agree(rng, scale, power):
    """Tried: sizes of any kind believed (LARGEST_SIZE), with which views overflow, and last bits are others."""
    positions, triangles = meshes.make_icosphere(2)
    caster = replace(raytracer.build(mesh_scene((positions * scale, triangles))), smallest_pencil=16)
    directions = rng.normal(size=(200, 3)) - (0, 0, 3)
    directions *= 10.0 ** rng.uniform(min(power, 0), max(power, 0), (200, 1))
    rays = make_rays(np.tile(np.array([0.1, 0.2, 3.0]) * scale, (200, 1)), directions)
    true = replace(caster, offer=offer_all, smallest_pencil=None).closest_hit(rays.origins, rays.directions)
    assert true.hit.sum() > 40
    form = replace(caster, offer=MatrixForm(caster.primitives), smallest_pencil=None)
    for other in (caster, form):
        assert_same_hits(other.closest_hit(rays.origins, rays.directions), true)


@pytest.mark.parametrize(
    ("subdivisions", "drawn"),
    [(1, {"closest leaving"}), (3, {"closest leaving", "any leaving", "closest parallel"})],
)
def test_pencils_are_drawn_or_projected_where_that_is_quicker(rng, subdivisions, drawn):
    """Among a few triangles the matrix form, among many the dense tree takes the others."""
    caster = replace(raytracer.build(mesh_scene(meshes.make_icosphere(subdivisions))), smallest_pencil=64)
    points, other = rng.normal(size=(300, 3)) + 5.0, np.tile((0.1, 0.2, 0.3), (300, 1))
    pencils = {
        "leaving": make_rays(other, points),
        "arriving": make_rays(points, other - points, 0.0, 1.0),
        "parallel": make_rays(points, other),
    }
    found = {
        f"{'any' if any_hit else 'closest'} {name}"
        for name, rays in pencils.items()
        for any_hit in (False, True)
        if all(offer is not caster.offer for _, offer in caster._plan(rays, any_hit))
    }
    assert found == drawn


@pytest.mark.parametrize(("count", "drawn"), [(447, False), (448, True)])
def test_rays_that_arrive_at_a_point_are_drawn_where_they_are_many_for_the_triangles(rng, monkeypatch, count, drawn):
    monkeypatch.setattr(casting_caster, "ARRIVING_RAYS", 64)
    caster = replace(raytracer.build(mesh_scene(meshes.make_icosphere(3))), smallest_pencil=64)
    point = np.array((0.3, 2.0, 0.1))
    points = rng.normal(size=(count, 3)) * (2.0, 0.3, 2.0) - (0.0, 2.0, 0.0)
    rays = make_rays(points, point - points, 0.0, 1.0)
    assert all((offer is caster.offer) != drawn for _, offer in caster._plan(rays, True))
    blocked = caster.any_hit(points, point - points, 0.0, 1.0)
    assert 0.2 < blocked.mean() < 0.8
    np.testing.assert_array_equal(blocked, caster.closest_hit(points, point - points, 0.0, 1.0).hit)


def test_limits_are_below_the_nearness_of_hits_within_range_and_close_to_it(rng):
    step, t = np.exp(rng.normal(size=(2, 10000)) * 5)
    limit, true = limit_nearness(step, t).astype(np.longdouble), 1 / (step.astype(np.longdouble) * t)
    assert (limit < true * (1 - RANGE_SLACK / 2)).all()
    assert (limit * np.float32(1 + 4 * RANGE_SLACK) > true * (1 + RANGE_SLACK / 2)).all()
    with np.errstate(divide="ignore"):
        at_origin = limit_nearness(np.ones(3), np.array([-np.inf, 0.0, np.inf]))
    np.testing.assert_array_equal(at_origin, np.array([np.inf, 2.0**127, 0.0]))


def find_grid(directions):
    return find_pixel_grid(make_rays((1.0, 2.0, 3.0), directions), 1.0)


@pytest.mark.parametrize("skipped", [0, 5, WIDE - 1])
@pytest.mark.parametrize("normalized", [False, True])
def test_grids_of_pixels_are_recognized_wherever_they_begin(rng, skipped, normalized):
    directions = make_pixels(np.array([0.3, 2.0, 0.1]), (0.03, 0, 0.01), (-0.01, 0, 0.03))
    if normalized:
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions = directions[skipped:-3]
    grid = find_grid(directions)
    assert type(grid) is PixelGrid
    assert (grid.wide, grid.high, grid.skipped) == (WIDE, HIGH, skipped)
    mapped = grid.matrix.astype(np.longdouble) @ directions.T
    cell = np.arange(len(directions)) + skipped
    places = np.stack([cell % WIDE, cell // WIDE]) + grid.low
    assert np.abs(mapped[:2] / mapped[2] - places).max() <= grid.ray_error < 1e-9
    np.testing.assert_allclose(mapped[2].astype(float), grid.step, rtol=1e-12)


def test_jittered_grids_hold_every_ray_once_near_its_cell(rng):
    along, across = (0.03, 0, 0.01), (-0.01, 0, 0.03)
    pixels = make_pixels(np.array([0.3, 2.0, 0.1]), along, across)
    directions = jitter(rng, pixels, along, across, "box", 1.0)
    grid = find_grid(directions[7:])
    assert type(grid) is JitteredGrid
    grid.set_ranges(np.zeros(len(grid.step)), np.full(len(grid.step), np.inf))
    place = np.flatnonzero(grid.limit < np.inf).astype(np.int32)
    np.testing.assert_array_equal(grid.name_rays(place), np.arange(len(grid.step)))
    mapped = grid.matrix.astype(np.longdouble) @ directions[7:].T
    points = np.stack([grid.xy[place].real, grid.xy[place].imag])
    assert np.abs(mapped[:2] / mapped[2] - points).max() <= grid.ray_error
    cells = np.stack([place % grid.stride, place // grid.stride]) + grid.low
    assert 0.45 < np.abs(points - cells).max() <= grid.jitter <= MOST_JITTER + 1e-4
    # With a filter of longer tails they are sorted.
    assert find_grid(jitter(rng, pixels, along, across, "blackman_harris", 1.5)) is None


def test_other_rays_are_no_grid(rng):
    scattered = rng.normal(size=(WIDE * HIGH, 3)) * 0.1 + (0, 1, 0)
    assert find_grid(scattered) is None
    line = make_pixels(np.array([0.3, 2.0, 0.1]), (0.03, 0, 0), (0.03, 0, 0))
    assert find_grid(line) is None
    around = make_pixels(np.array([0.0, 0.0, 0.0]), (1, 0, 0), (0, 1, 0)) + np.array([0.0, 0.0, 1e-9])
    assert find_grid(np.roll(around, 7, axis=0)[:50]) is None
    wave = make_pixels(np.array([0.3, 2.0, 0.1]), (0.03, 0, 0), (0, 0, 0.03))
    wave[:, 2] += 0.2 * np.sin(np.arange(len(wave)))
    assert find_grid(wave) is None


def make_strips(directions):
    """The StripGrid of rays from the origin, all of which ask for anything."""
    rays = make_rays((0.0, 0.0, 0.0), directions)
    [view] = make_views(find_pencil(rays), rays, 1.0)
    grid = StripGrid(view)
    grid.set_ranges(np.zeros(len(rays)), np.full(len(rays), np.inf))
    return grid


def test_strips_hold_every_ray_once_in_its_cell(rng):
    directions = np.concatenate([rng.normal(size=(9000, 2)) * 0.2, np.ones((9000, 1))], axis=1)
    grid = make_strips(directions)
    place = np.arange(9000)
    assert sorted(grid.name_rays(place).tolist()) == list(range(9000))
    points = np.stack([grid.x, grid.y])
    mapped = grid.matrix.astype(np.longdouble) @ directions[grid.name_rays(place)].T
    assert np.abs(mapped[:2] / mapped[2] - points).max() <= grid.ray_error
    cell = np.repeat(np.arange(len(grid.first) - 1), np.diff(grid.first))
    low = np.stack([cell % grid.wide, cell // grid.wide * STRIP]) + grid.low
    assert (points >= low).all()
    assert (points < low + np.array([[1], [STRIP]])).all()
    tiles = grid.limit_tiles()
    assert (tiles.shape, tiles.min()) == ((grid.high // grid.tile, grid.wide // grid.tile), 0.0)


def test_tiles_of_strips_have_the_least_limit_of_their_rays(rng):
    grid = make_strips(np.concatenate([rng.normal(size=(3000, 2)) * 0.2, np.ones((3000, 1))], axis=1))
    grid.limit = rng.random(3000).astype(np.float32)
    column, row = (np.floor(np.stack([grid.x, grid.y])) - grid.low).astype(int) // grid.tile
    expected = np.full((grid.high // grid.tile, grid.wide // grid.tile), np.float32(np.inf))
    np.minimum.at(expected, (row, column), grid.limit)
    assert np.isinf(expected).any()
    np.testing.assert_array_equal(grid.limit_tiles(), expected)


@pytest.mark.parametrize("count", [70, 3000])
def test_runs_are_the_rays_of_the_strips_of_boxes_near_their_base(rng, count):
    """Boxes of cells: every ray in one once, none beyond its columns, nor farther from the base than it may be."""
    directions = np.concatenate([rng.normal(size=(count, 2)) * 0.2, np.ones((count, 1))], axis=1)
    directions[: count // 2, :2] = 0.3 + 0.001 * rng.normal(size=(count // 2, 2))  # so close that runs are cut
    grid = make_strips(directions)
    sizes = np.array([[grid.wide], [grid.high]])
    first = rng.integers(0, sizes, (2, 400))
    first[:, :100] = (np.floor([grid.x[:1], grid.y[:1]]) - grid.low).astype(int)
    last = np.minimum(first + rng.integers(0, 23, (2, 400)), sizes - 1)
    plan = grid.plan(first.astype(np.float32), last.astype(np.float32))
    length = np.repeat(np.arange(LONGEST + 1), plan.notes.number)
    assert (length == LONGEST).any()
    item = np.repeat(plan.notes.item, length)
    place = np.concatenate([start + np.arange(n) for start, n in zip(plan.notes.place, length, strict=True)])
    points = np.stack([grid.x, grid.y]).astype(float)
    column, row = (np.floor(points) - grid.low).astype(int)
    expected = [
        (k, ray)
        for k, ((x0, y0), (x1, y1)) in enumerate(zip(first.T, last.T, strict=True))
        for ray in np.flatnonzero(
            (column >= x0) & (column <= x1) & (row // STRIP >= y0 // STRIP) & (row // STRIP <= y1 // STRIP)
        )
    ]
    assert sorted(zip(item.tolist(), place.tolist(), strict=True)) == expected
    share = np.abs(points[:, place] - plan.base[:, item]).max(axis=0) / plan.reach[item]
    assert 0.9 < share.max() <= 1


def test_clusters_hold_every_triangle_once_inside_their_boxes(rng):
    scene = mesh_scene(meshes.make_torus(20, 11), meshes.make_soup(rng, 70))
    primitives = raytracer.build(scene).primitives
    clusters = make_clusters(primitives)
    ids = clusters.primitive_id.ravel()
    assert sorted(ids[ids >= 0].tolist()) == list(range(len(primitives.corners)))
    corners = clusters.vertices[:, clusters.corners].transpose(1, 3, 2, 0)  # (c, CLUSTER, 3 corners, 3)
    real = clusters.primitive_id >= 0
    np.testing.assert_array_equal(corners[real], primitives.corners.reshape(-1, 3, 3)[clusters.primitive_id[real]])
    away = np.abs(corners - clusters.centre[:, np.newaxis, np.newaxis]).max(axis=(1, 2))
    assert (away <= clusters.half).all()
    assert len(clusters.half) == -(-len(primitives.corners) // CLUSTER)


@pytest.mark.parametrize("origin", [(0.1, -3.0, 0.2), (0.9, 0.0, 0.1), (0.0, 0.0, 0.0)])
def test_clusters_in_view_hold_all_vertices_in_view(origin):
    clusters = make_clusters(raytracer.build(mesh_scene(meshes.make_torus(60, 40))).primitives)
    directions = make_pixels(np.array([0.0, 1.0, 0.0]), (0.02, 0, 0), (0, 0, 0.02))
    grid = find_pixel_grid(make_rays(origin, directions), 1.0)
    with np.errstate(all="ignore"):
        index, box = cull_clusters(grid, clusters)
        points = project_vertices(grid, clusters.vertices)
    x, y, nearness = points[:2, :, None][0], points[:2, :, None][1], points[2]
    x, y = x[:, 0] - grid.low[0], y[:, 0] - grid.low[1]
    seen = (x >= 0) & (x <= grid.wide - 1) & (y >= 0) & (y <= grid.high - 1)
    for cluster, corners in enumerate(clusters.corners.reshape(-1, 3 * CLUSTER)):
        used = corners[seen[corners]]
        place = np.flatnonzero(index == cluster)
        assert len(place) or not len(used)
        for one in place:
            assert (box[0, one] <= x[used]).all()
            assert (x[used] <= box[2, one]).all()
            assert (box[1, one] <= y[used]).all()
            assert (y[used] <= box[3, one]).all()
            assert (nearness[used] <= box[4, one]).all()
    assert (index.size > 0, (np.diff(1 / box[4, np.isfinite(box[4])]) > -1e-3).all()) == (True, True)


def test_boxes_are_hidden_where_all_tiles_are_nearer(rng):
    tiles = rng.random((13, 21), dtype=np.float32)
    tiles[2:9, 4:17] += np.float32(1.0)
    low = rng.uniform(-8, 21 * 8, (2, 3000))
    box = np.concatenate([low, low + rng.exponential(20, (2, 3000)), rng.uniform(0, 1.5, (1, 3000))]).astype(np.float32)
    hidden = are_hidden(tiles, box, 8)
    (x0, y0), (x1, y1) = (np.clip(box[k : k + 2] / 8, 0, [[20], [12]]).astype(int) for k in (0, 2))
    least = np.array([tiles[b : d + 1, a : c + 1].min() for a, b, c, d in zip(x0, y0, x1, y1, strict=True)])
    # A pyramid may look at more tiles than a box meets, never at fewer.
    assert not (hidden & (box[4] >= least)).any()
    assert hidden.sum() > 0.5 * (box[4] < least).sum() > 50


@pytest.mark.parametrize("scale", [1.0, 1e300, 5e-324])
def test_places_on_the_curve_are_numbers_whatever_the_size(scale):
    """One triangle has one middle; the largest numbers must not overflow, the smallest must not be divided by."""
    one = np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0)]) * scale
    assert place_on_curve(one, np.array([(0, 1, 2)])).tolist() == [0]
    two = np.concatenate([-one, one])
    places = place_on_curve(two, np.array([(0, 1, 2), (3, 4, 5)]))
    assert (places >= 0).all()
    assert places[0] <= places[1]
