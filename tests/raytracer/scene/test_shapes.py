"""Meshes that are made of others."""

from __future__ import annotations

import numpy as np
import pytest

import raytracer


def test_a_mesh_with_another_material_shares_its_arrays_and_is_checked() -> None:
    mesh = raytracer.Mesh(
        [(0, 0, 0), (1, 0, 0), (0, 1, 0)], [(0, 1, 2)], name="Leaf", attributes={"a": np.ones((3, 1))}
    )
    other = mesh.with_material(np.array([7]), {"b": np.ones((3, 2))})
    assert other.positions is mesh.positions
    assert (other.material.tolist(), set(other.attributes)) == ([7], {"b"})
    assert (mesh.material, set(mesh.attributes)) == (0, {"a"})
    assert set(mesh.with_material(2).attributes) == {"a"}
    with pytest.raises(ValueError, match=r"Mesh 'Leaf': material: expected indices of 0 or more, got -1"):
        mesh.with_material(-1)
    with pytest.raises(ValueError, match=r"Mesh 'Leaf': material: expected shape \(1,\) int32, got \(2,\)"):
        mesh.with_material([0, 1])
    with pytest.raises(ValueError, match=r"Mesh 'Leaf': material"):
        mesh.with_material(2**31)
    with pytest.raises(ValueError, match=r"Mesh 'Leaf': attribute 'b'"):
        mesh.with_material(0, {"b": np.ones((2, 2))})
