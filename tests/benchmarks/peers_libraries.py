"""Ray casters of other libraries as peers, each on one thread: Embree by Open3D and embreex, Mitsuba 3, trimesh.

Embree and Mitsuba are float32; Open3D asks Embree for its robust mode, embreex does not. trimesh's caster is NumPy in
float64 with the rtree library for candidates.
"""

from __future__ import annotations

from importlib import import_module

import numpy as np

from tests.benchmarks.peers import Answer, Built, Peer, miss_all, project_location

OPEN3D, EMBREEX, MITSUBA, TRIMESH = "Embree (Open3D)", "Embree (embreex)", "Mitsuba 3", "trimesh (NumPy)"
# trimesh takes 0.1 to 10 milliseconds per ray.
TRIMESH_RAY_LIMIT = 512
MITSUBA_VARIANT = "llvm_ad_rgb"


def as_float32(vectors):
    """Contiguous float32 of (n, 3); benchmark rays are chosen so that nothing is rounded."""
    return np.ascontiguousarray(vectors, dtype=np.float32)


def load_open3d(name):
    """Open3D's RaycastingScene: Embree in robust mode."""
    open3d = import_module("open3d")
    return Peer(name, f"Open3D {open3d.__version__}", build_open3d)


def build_open3d(positions, triangles):
    """Build an Embree scene by Open3D."""
    from open3d import core, t

    scene = t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(core.Tensor(as_float32(positions)), core.Tensor(triangles.astype(np.uint32)))

    def prepare(origins, directions, reach):
        return core.Tensor(np.concatenate([as_float32(origins), as_float32(directions)], axis=1)), reach

    def read(found):
        t_hit, primitive = found["t_hit"].numpy().astype(np.float64), found["primitive_ids"].numpy()
        return Answer(t_hit, np.where(np.isfinite(t_hit), primitive.astype(np.int64), -1))

    return Built(
        prepare,
        cast=lambda rays: scene.cast_rays(rays[0], nthreads=1),
        read=read,
        occlude=lambda rays: scene.test_occlusions(rays[0], tnear=0.0, tfar=rays[1], nthreads=1),
    )


def load_embreex(name):
    """embreex, the binding that trimesh uses."""
    embreex = import_module("embreex")
    return Peer(name, f"embreex {embreex.__version__}", build_embreex)


def build_embreex(positions, triangles):
    """Build an Embree scene by embreex."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    scene = EmbreeScene()
    mesh = TriangleMesh(scene, as_float32(positions), triangles.astype(np.int32))

    def cast(rays):
        return scene.run(*rays, query="INTERSECT", output=1), mesh  # the mesh must live as long as the scene

    def read(found):
        primitive = found[0]["primID"].astype(np.int64)
        hit = found[0]["geomID"] >= 0
        return Answer(np.where(hit, found[0]["tfar"].astype(np.float64), np.inf), np.where(hit, primitive, -1))

    return Built(lambda origins, directions, reach: (as_float32(origins), as_float32(directions)), cast, read)


def load_mitsuba(name):
    """Mitsuba 3 with its default vectorised variant, which needs the LLVM library of the system."""
    mitsuba, drjit = import_module("mitsuba"), import_module("drjit")
    mitsuba.set_variant(MITSUBA_VARIANT)
    try:
        drjit.eval(mitsuba.Float([1.0, 2.0]) * 2)
    except RuntimeError as error:
        raise ImportError(f"{MITSUBA_VARIANT}: {str(error).splitlines()[0]}") from None
    drjit.set_thread_count(1)
    return Peer(name, f"Mitsuba {mitsuba.__version__} {MITSUBA_VARIANT}", build_mitsuba)


def build_mitsuba(positions, triangles):
    """Build a Mitsuba scene of one mesh."""
    import drjit
    import mitsuba

    mesh = mitsuba.Mesh("mesh", len(positions), len(triangles))
    parameters = mitsuba.traverse(mesh)
    parameters["vertex_positions"] = as_float32(positions).ravel()
    parameters["faces"] = triangles.astype(np.uint32).ravel()
    parameters.update()
    scene = mitsuba.load_dict({"type": "scene", "mesh": mesh})

    def prepare(origins, directions, reach):
        start, heading = mitsuba.Point3f(as_float32(origins).T), mitsuba.Vector3f(as_float32(directions).T)
        rays = mitsuba.Ray3f(start, heading, mitsuba.Float(reach), mitsuba.Float(0.0), [])
        drjit.eval(rays)
        drjit.sync_thread()
        return rays

    def cast(rays):
        found = scene.ray_intersect_preliminary(rays, coherent=False)
        drjit.eval(found)
        drjit.sync_thread()
        return found

    def read(found):
        hit = np.asarray(found.is_valid())
        primitive = np.asarray(found.prim_index).astype(np.int64)
        return Answer(np.where(hit, np.asarray(found.t, dtype=np.float64), np.inf), np.where(hit, primitive, -1))

    return Built(prepare, cast, read)


def load_trimesh(name):
    """trimesh's own caster, without Embree."""
    trimesh = import_module("trimesh")
    import_module("rtree")
    return Peer(name, f"trimesh {trimesh.__version__}", build_trimesh, TRIMESH_RAY_LIMIT)


def build_trimesh(positions, triangles):
    """Build trimesh's R-tree over the mesh, its vertices and faces left as they are."""
    import trimesh
    from trimesh.ray.ray_triangle import RayMeshIntersector

    caster = RayMeshIntersector(trimesh.Trimesh(positions, triangles, process=False))
    caster.mesh.triangles_tree  # noqa: B018 - a cached property: this builds the tree

    def cast(rays):
        return rays, caster.intersects_id(*rays, multiple_hits=False, return_locations=True)

    def read(found):
        (origins, directions), (primitive, ray, locations) = found
        t, index = miss_all(len(origins))
        ray = np.asarray(ray, dtype=np.int64)
        index[ray] = primitive
        t[ray] = project_location(origins[ray], directions[ray], np.reshape(locations, (-1, 3)))
        return Answer(t, index)

    return Built(lambda origins, directions, reach: (origins, directions), cast, read)


PEERS = {OPEN3D: load_open3d, EMBREEX: load_embreex, MITSUBA: load_mitsuba, TRIMESH: load_trimesh}
