"""What float32 is certain of is true, and all hits are those of brute force, bit for bit.

Tried: the roundings of lines and of ends, and the bound of sides, a hundredth of what they are; T well known from
anywhere on; ranges that end before h; rays settled whatever else is left, or without a triangle that is met; ends
nearer than the inverse is kept for; each turned red.
"""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

import raytracer
from raytracer.casting import matrix_form
from raytracer.casting.brute_force import offer_all
from raytracer.casting.framed import frame_rays
from raytracer.casting.matrix_certain import CERTAIN, LEAST_SIDE
from raytracer.casting.planes import make_lines, meet_planes
from tests.meshes import join_meshes, make_cube

FIELDS = ("distance", "distance_error", "instance", "primitive", "barycentric", "valid")


@pytest.fixture
def everywhere(monkeypatch):
    """All queries look at all pairs."""
    monkeypatch.setattr(matrix_form, "FEWEST_RAYS", 1)
    monkeypatch.setattr(matrix_form, "MET_SHARE", -1.0)


def build_triangles(corners, **others):
    """A caster of triangles (t, 3 corners, 3)."""
    mesh = raytracer.Mesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
    return raytracer.build(raytracer.Scene(meshes=[mesh], **others))


def make_triangles(rng, count, offset=0.0):
    """Triangles of many sizes, a third of them in axis planes, a third slivers."""
    corners = rng.normal(size=(count, 3, 3)) * 10.0 ** rng.uniform(-2, 0, size=(count, 1, 1))
    corners += rng.uniform(-1, 1, size=(count, 1, 3))
    for k in range(0, count, 3):
        corners[k, :, k % 2] = corners[k, 0, k % 2]
    corners[1::3, 2] = 0.3 * corners[1::3, 0] + 0.7 * corners[1::3, 1] + 1e-6 * rng.normal(size=corners[1::3, 2].shape)
    return corners + offset


def exact(vector):
    return [Fraction(float(x)) for x in vector]


def dot(p, q):
    return sum(x * y for x, y in zip(p, q, strict=True))


def subtract(p, q):
    return [x - y for x, y in zip(p, q, strict=True)]


def cross(p, q):
    return [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]]


def multiply(form, rays, reach):
    """The Packets of a few rays, one batch."""
    with np.errstate(all="ignore"):
        (packets,) = form._multiply(rays, reach, 1.0)
        form._compare_sides(packets)
    return packets


@pytest.mark.parametrize("offset", [0.0, 3.7, 1e4])
def test_sides_are_within_their_bounds(rng, offset):
    """T of rays that start in or next to planes, and Z of ends that lie in or next to them, against fractions."""
    corners = make_triangles(rng, 30, offset)
    caster = build_triangles(corners)
    form, frame = caster.offer.certain, caster.offer.frame
    rows = rng.integers(30, size=120)
    starts = np.einsum("nk,nkj->nj", rng.dirichlet(np.ones(3), 120), corners[rows])
    away = rng.normal(size=(120, 3))
    away[::2] *= 1e-15
    reach = rng.uniform(0.5, 3, 120)
    directions = rng.normal(size=(120, 3))
    ends = rng.random(120) < 0.5
    starts = np.where(ends[:, None], starts - reach[:, None] * directions, starts) + away
    rays = frame_rays(frame, starts, directions)
    packets = multiply(form, rays, reach * rays.unit)
    unit = Fraction(2) ** frame.exponent
    shares = {"T": [], "Z": []}
    for n, row in enumerate(rows):
        a, b, c = (exact(corner) for corner in corners[row])
        normal = cross(subtract(b, a), subtract(c, a))
        plane = form.plane[row]
        used = -form.side_columns[plane, :3]
        largest = int(np.abs(used).argmax())
        normal = [x / normal[largest] * Fraction(float(used[largest])) for x in normal]
        direction = [x / Fraction(float(rays.unit[n])) * unit for x in exact(directions[n])]
        side = dot(normal, subtract(a, exact(starts[n]))) * unit
        inverse = 1 / (Fraction(float(reach[n])) * Fraction(float(rays.unit[n])))
        end = inverse * side - dot(normal, direction)
        place = 0, plane, n
        shares["T"].append(float(abs(Fraction(float(packets.wide[place])) - side)) / packets.side_error[plane, 0])
        shares["Z"].append(float(abs(Fraction(float(packets.end[place])) - end)) / packets.end_error[plane, 0])
        if form.errors[0][plane, 0] == LEAST_SIDE:  # an axis plane: the sign is true, or there is none
            computed = float(packets.wide[place])
            shares["T"].pop()
            assert computed == 0 or (computed > 0) == (side > 0)
    assert 1 / 100 < max(shares["T"]) <= 1
    assert 1 / 100 < max(shares["Z"]) <= 1


def test_lines_pass_outside_or_inside_as_is_certain(rng):
    """Of lines that pass edges at all distances, down to none."""
    corners = rng.choice([-1, 1], size=(20, 3, 3)) * rng.uniform(0.7, 1, size=(20, 3, 3))
    caster = build_triangles(corners)
    rows = rng.integers(20, size=12000)
    weights = rng.dirichlet(np.ones(3), 12000)
    weights[:, 0] = rng.choice([-1, 1], 12000) * 10.0 ** rng.uniform(-8, -4, 12000)
    weights /= weights.sum(axis=1, keepdims=True)
    origins = rng.uniform(-1.5, 1.5, size=(12000, 3))
    directions = np.einsum("nk,nkj->nj", weights, corners[rows]) - origins
    rays = frame_rays(caster.offer.frame, origins, directions)
    with np.errstate(all="ignore"):
        blocks = [packets.outside.copy() for packets in caster.offer.certain._multiply(rays, np.ones(12000), 1.0)]
    outside = np.concatenate(blocks).transpose(0, 2, 1).reshape(-1, 20)[np.arange(12000), rows]
    certain = np.flatnonzero(np.abs(outside) > CERTAIN)
    for n in certain:
        p, q, r = (subtract(exact(corner), exact(origins[n])) for corner in corners[rows[n]])
        signs = [dot(exact(directions[n]), cross(*pair)) for pair in ((q, r), (r, p), (p, q))]
        inside = min(signs) > 0 or max(signs) < 0
        assert (outside[n] < 0) == inside
        assert inside or min(signs) < 0 < max(signs)
    assert 400 < len(certain) < 10000


def compare(caster, origins, directions, t_max=np.inf):
    """Hits and occlusion are those of brute force; return the hits."""
    plain = replace(caster, offer=offer_all, smallest_pencil=None, drawn=None)
    caster = replace(caster, smallest_pencil=None, drawn=None)
    hits = caster.closest_hit(origins, directions, 0.0, t_max)
    true = plain.closest_hit(origins, directions, 0.0, t_max)
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(hits, name), getattr(true, name), err_msg=name)
    any_hit = caster.any_hit(origins, directions, 0.0, t_max)
    np.testing.assert_array_equal(any_hit, plain.any_hit(origins, directions, 0.0, t_max))
    return hits


def make_room(rng):
    """A room, boxes that stand on its floor, one turned, and triangles that lie on others or hardly off them."""
    boxes = [make_cube(1.0), make_cube(0.25, (0.3, 0.2, -0.75)), make_cube(0.2, (-0.4, -0.3, -0.3))]
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    boxes[2] = ((boxes[2][0] - boxes[2][0].mean(axis=0)) @ turn.T + boxes[2][0].mean(axis=0), boxes[2][1])
    positions, triangles = join_meshes(boxes)
    corners = positions[triangles]
    lifted = corners[rng.integers(len(corners), size=6)]
    lifted = lifted + 10.0 ** rng.uniform(-16, -5, size=(6, 1, 1)) * rng.normal(size=(6, 1, 3))
    return np.concatenate([corners, corners[3:4], lifted])


def aim(rng, corners, count):
    """Rays from anywhere, from surfaces, and from next to them, to places inside, edges, and vertices, along planes."""
    rows, others = rng.integers(len(corners), size=(2, count))
    weights = rng.dirichlet(np.ones(3), count)
    weights[: count // 8, 0] = 0
    weights[: count // 16, 1] = 0
    weights /= weights.sum(axis=1, keepdims=True)
    targets = np.einsum("nk,nkj->nj", weights, corners[rows])
    origins = np.einsum("nk,nkj->nj", rng.dirichlet(np.ones(3), count), corners[others])
    origins += 10.0 ** rng.uniform(-18, 1, size=(count, 1)) * rng.normal(size=(count, 3))
    origins[::5] = rng.normal(size=origins[::5].shape) * 3
    along = slice(2, None, 7)
    directions = targets - origins
    directions[along] = corners[rows[along], 1] - corners[rows[along], 0]
    directions[along] += 10.0 ** rng.uniform(-18, -2, size=(len(directions[along]), 1))
    return origins, directions


@pytest.mark.parametrize("offset", [0.0, 5.3, 1e5])
def test_hits_of_hard_rays_are_those_of_brute_force(rng, everywhere, offset):
    corners = make_room(rng) + offset
    origins, directions = aim(rng, corners, 6000)
    hits = compare(build_triangles(corners), origins, directions)
    assert hits.hit.mean() > 0.5


def test_ranges_that_end_next_to_hits_are_kept(rng, everywhere):
    corners = make_room(rng)
    caster = build_triangles(corners)
    origins, directions = aim(rng, corners, 3000)
    distance = caster.closest_hit(origins, directions).distance
    t_max = distance * (1 + rng.choice([-1, 0, 1], 3000) * 10.0 ** rng.uniform(-17, -1, 3000))
    t_max[np.isnan(t_max)] = 1.0
    hits = compare(caster, origins, directions, t_max)
    assert 0.3 < hits.hit.mean() < 0.9


def test_spheres_among_triangles_are_hit_where_they_are_nearer(rng, everywhere):
    corners = make_room(rng)
    spheres = raytracer.Spheres(rng.uniform(-0.9, 0.9, size=(5, 3)), np.full(5, 0.3))
    hits = compare(build_triangles(corners, spheres=[spheres]), *aim(rng, corners, 3000))
    assert {0, 1} <= set(hits.instance.tolist())


def test_settled_hits_are_well_within_their_range(rng):
    """So that `query` would be certain of them, too: what is in doubt is far less than their distance."""
    corners = make_room(rng)
    form = build_triangles(corners).offer
    origins, directions = aim(rng, corners, 8000)
    rays = frame_rays(form.frame, origins, directions)
    with np.errstate(all="ignore"):
        nearest = form.certain.find_nearest(rays, np.full(8000, np.inf))
        lane = np.flatnonzero(nearest.certain)
        lines = make_lines(rays.place.take(lane, axis=1), rays.direction.take(lane, axis=1), 0.0)
        planes = form.planes.take(nearest.row.take(lane), axis=0)
        distance, bound = meet_planes(planes.T, lines.T)
    assert len(lane) > 400
    assert (planes[:, 7] * bound < 2.0**-14 * distance).all()


@pytest.mark.parametrize("scale", [1e-200, 1e-30, 1e30, 1e200])
def test_directions_and_scenes_of_any_size_are_cast(rng, everywhere, scale):
    corners = make_triangles(rng, 12)
    origins, directions = aim(rng, corners, 1500)
    compare(build_triangles(corners), origins, directions * scale)
    compare(build_triangles(corners * 1e20), origins * 1e20, directions * scale)
    far = origins + 1e7 * rng.normal(size=(1500, 1)) * directions
    compare(build_triangles(corners), far, directions)


def test_walls_an_ulp_off_an_axis_plane_are_not_taken_for_one(rng, everywhere):
    """Placing them in the frame makes them level: what starts between the wall and that plane is in doubt."""
    corners = np.array([[[-1.0, -1, 0.1], [1, -1, 0.1], [0, 1, 0.1]], [[-1, -1, -1.9], [1, -1, -1.9], [0, 1, -1.5]]])
    corners[0, 2, 2] = np.nextafter(0.1, 1)
    form = build_triangles(corners).offer.certain
    assert form.errors[0][form.plane[0], 0] > LEAST_SIDE
    origins = np.einsum("nk,kj->nj", rng.dirichlet(np.ones(3), 500), corners[0])
    directions = rng.normal(size=(500, 3))
    compare(build_triangles(corners), origins, directions)


def test_triangles_of_an_axis_plane_share_it():
    positions, triangles = make_cube(1.0)
    form = build_triangles(positions[triangles]).offer.certain
    assert len(form.side_columns) == 6
    assert (form.plane[::2] == form.plane[1::2]).all()


def test_most_rays_of_a_room_are_settled_without_a_list(rng, everywhere, monkeypatch):
    """The point of it all: else nothing is gained."""
    decided, decide = [], matrix_form.MatrixForm._decide

    def note(form, decisions, ray):
        decided.append(len(ray))
        decide(form, decisions, ray)

    monkeypatch.setattr(matrix_form.MatrixForm, "_decide", note)
    positions, triangles = make_cube(1.0)
    caster = build_triangles(positions[triangles])
    hits = caster.closest_hit(rng.uniform(-0.9, 0.9, size=(5000, 3)), rng.normal(size=(5000, 3)))
    assert hits.hit.all()
    assert sum(decided) < 50
