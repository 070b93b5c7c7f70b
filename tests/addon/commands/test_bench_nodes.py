"""Blender's Raycast node in the benchmark: does each cast evaluate it once, does it know its faces, is it compared?"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests import meshes
from tests.benchmarks import peers_nodes, tables
from tests.benchmarks.peers import Built, Peer, ask, find_loaders, load_peers
from tests.benchmarks.peers_nodes import RAYCAST
from tests.benchmarks.peers_ours import CERTIFIED
from tests.benchmarks.truth import find_truth

bpy = pytest.importorskip("bpy", reason="needs Blender")
pytestmark = pytest.mark.blender
# Float32 distances and locations: some roundings of the node's arithmetic, each of the size of coordinates, about 1.
ROUNDING = 16 * np.finfo(np.float32).eps
# Of the icosphere of 1280 triangles; differences of vertices, and so normals, are that much less exact than vertices.
SHORTEST_EDGE = 0.138


def load() -> tuple[list[Peer], dict[str, str]]:
    return load_peers({RAYCAST: find_loaders()[RAYCAST]})


def build(mesh: Any) -> Built:
    return load()[0][0].build(*mesh)


def test_raycast_node_finds_what_the_exact_oracle_does() -> None:
    positions, triangles = meshes.make_icosphere(3)
    positions = positions.astype(np.float32).astype(np.float64)
    generator = np.random.default_rng(2)
    ends = generator.normal(size=(2, 300, 3)).astype(np.float32).astype(np.float64)
    origins, directions = ends[0], ends[1] - ends[0]
    truth = find_truth(origins, directions, positions[triangles])
    assert 50 < (truth.index >= 0).sum() < 250
    built, hit = build((positions, triangles)), truth.index >= 0
    found = built.cast(built.prepare(origins, directions, np.inf))
    heard = built.read(found)
    np.testing.assert_array_equal(heard.primitive, truth.index)
    np.testing.assert_allclose(heard.t[hit], truth.nearest[hit], rtol=ROUNDING, atol=ROUNDING)
    location, normal = (found[1][name].reshape(-1, 3)[hit] for name in ("location", "normal"))
    np.testing.assert_allclose(location, (origins + truth.nearest[:, None] * directions)[hit], atol=ROUNDING)
    a, b, c = np.moveaxis(positions[triangles[truth.index[hit]]], 1, 0)
    across = np.cross(b - a, c - a)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    np.testing.assert_allclose(normal, across, atol=ROUNDING / SHORTEST_EDGE)


def test_every_cast_evaluates_the_rays_and_leaves_the_target_alone() -> None:
    """Else the clock would time nothing, or the target's tree being built."""
    built = build(meshes.make_quad())
    prepared = built.prepare(np.array([(0.1, 0.2, 1.0)]), np.array([(0, 0, -1.0)]), np.inf)
    built.cast(prepared)
    updated: list[tuple[str, str]] = []

    def listen(scene: Any, depsgraph: Any) -> None:
        changed = (update.id for update in depsgraph.updates if update.is_updated_geometry)
        updated.extend((type(data).__name__, data.name) for data in changed)

    bpy.app.handlers.depsgraph_update_post.append(listen)
    try:
        built.cast(prepared)
        built.cast(prepared)
    finally:
        bpy.app.handlers.depsgraph_update_post.remove(listen)
    assert updated == [("Object", f"{RAYCAST}, rays"), ("Mesh", f"{RAYCAST}, rays")] * 2


def test_raycast_node_is_evaluated_once_for_all_that_is_stored() -> None:
    """A Store Named Attribute that is linked to Raycast casts all rays again."""
    build(meshes.make_quad())
    links = bpy.data.node_groups[RAYCAST].links
    asked = {link.to_node.bl_idname for link in links if link.from_node.bl_idname == "GeometryNodeRaycast"}
    assert asked == {"GeometryNodeCaptureAttribute"}


def test_prepared_rays_replace_those_before() -> None:
    built = build(meshes.make_quad())
    for count in (1, 3):
        heard = ask(built, np.tile((0.1, 0.2, 2.0), (count, 1)), np.tile((0, 0, -1.0), (count, 1)))
        np.testing.assert_array_equal(heard.t, np.full(count, 2.0))
    assert len([mesh for mesh in bpy.data.meshes if mesh.name.startswith(f"{RAYCAST}, rays")]) == 1


def test_raycast_node_says_how_many_threads_it_may_use() -> None:
    peers, skipped = load()
    assert not skipped
    assert peers[0].version.endswith(f"Geometry Nodes on up to {peers_nodes.count_threads()} threads")


def test_a_missing_socket_or_node_skips_the_peer_with_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setitem(peers_nodes.FOUND, "hit", ("Was Hit", "BOOLEAN"))
        assert load() == ([], {RAYCAST: "not installed: Blender's node Raycast has no Was Hit among its outputs"})
    add_node = peers_nodes.add_node
    monkeypatch.setattr(
        peers_nodes, "add_node", lambda tree, kind, **properties: add_node(tree, f"{kind}Gone", **properties)
    )
    peers, skipped = load()
    assert peers == []
    assert "GeometryNodeRaycastGone" in skipped[RAYCAST]


def test_ratio_to_the_raycast_node_is_in_the_table() -> None:
    row = {"scene": "box", "family": "camera"}
    speeds = [row | {"peer": peer, "mrays_per_second": speed} for peer, speed in ((CERTIFIED, 3.0), (RAYCAST, 1.5))]
    (line,) = tables.list_ratios(speeds)
    assert dict(zip(tables.RATIOS, line, strict=True))["over Raycast node"] == "2.00"
    assert line.count(tables.NOTHING) == 4
