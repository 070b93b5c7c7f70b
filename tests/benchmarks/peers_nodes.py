"""Blender's Raycast node as a peer: what a user of Geometry Nodes casts arrays of rays with.

Rays are the vertices of a mesh, with attributes for direction and reach. Its modifier captures what the node finds, in
one evaluation of it, and stores that under names; a Store Named Attribute that is linked to Raycast itself would cast
all rays again. float32 inside.

References
----------
Blender, source/blender, nodes/geometry/nodes/node_geo_raycast.cc: directions are normalized in float32, distances are
in metres; blenkernel/BKE_attribute_math.hh, mix3: how an index is sampled; blenlib/intern/task_scheduler.cc: there are
as many threads as the system offers, unless Blender is started with `--threads`. A scene's `render.threads` is asked
by renders only (blenkernel/intern/scene.cc, BKE_render_num_threads), so a script cannot limit an evaluation.
"""

from __future__ import annotations

import os
from functools import partial

import numpy as np

from tests.benchmarks.peers import Answer, Built, Peer, miss_all
from tests.benchmarks.peers_blender import ANYWHERE, show_mesh

RAYCAST = "Blender Raycast node"
# Types of attributes -> (the same type among sockets, the field to read and write, type and width of arrays).
TYPES = {
    "BOOLEAN": ("BOOLEAN", "value", np.bool_, 1),
    "INT": ("INT", "value", np.int32, 1),
    "FLOAT": ("FLOAT", "value", np.float32, 1),
    "FLOAT_VECTOR": ("VECTOR", "vector", np.float32, 3),
}
# What is captured, stored and read back: name -> (output of the node, its type). An Answer has no place for location
# and normal, but Blender's other casters tell them as well; they take 1% of the time.
FOUND = {
    "hit": ("Is Hit", "BOOLEAN"),
    "location": ("Hit Position", "FLOAT_VECTOR"),
    "normal": ("Hit Normal", "FLOAT_VECTOR"),
    "distance": ("Hit Distance", "FLOAT"),
    "face": ("Attribute", "INT"),
}


def load(name):
    """Return the node as a Peer.

    Raises
    ------
    ImportError
        Without Blender, or where its nodes lack what is asked of them.
    """
    import bpy

    bpy.data.node_groups.remove(make_tree(None))
    return Peer(name, f"Blender {bpy.app.version_string} Geometry Nodes on up to {count_threads()} threads", build)


def count_threads():
    """Return how many threads Blender's task scheduler may use: one for each core that the process has."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()


def find_socket(node, side, name):
    """Return the socket of this name, among the "inputs" or "outputs", that is in use.

    Older versions keep one for each type of attribute.

    Raises
    ------
    ImportError
        If there is none.
    """
    found = next((socket for socket in getattr(node, side) if socket.name == name and socket.enabled), None)
    if found is None:
        raise ImportError(f"Blender's node {node.bl_label} has no {name} among its {side}")
    return found


def add_node(tree, kind, **properties):
    """Add a node of the type GeometryNode`kind`; return (node, its inputs by name, its outputs by name)."""
    try:
        node = tree.nodes.new(f"GeometryNode{kind}")
    except RuntimeError as error:
        raise ImportError(str(error).strip()) from None
    for name, value in properties.items():
        setattr(node, name, value)
    return node, partial(find_socket, node, "inputs"), partial(find_socket, node, "outputs")


def make_tree(target):
    """Return a node group that casts the rays at the object `target` and stores what is FOUND."""
    import bpy

    tree = bpy.data.node_groups.new(RAYCAST, "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    outputs = add_raycast(tree, target)
    capture, capture_input, captured = add_node(tree, "CaptureAttribute", domain="POINT")
    tree.links.new(tree.nodes.new("NodeGroupInput").outputs[0], capture_input("Geometry"))
    geometry = captured("Geometry")
    for name, (output, data_type) in FOUND.items():
        capture.capture_items.new(TYPES[data_type][0], name)
        tree.links.new(outputs(output), capture_input(name))
        _, store, stored = add_node(tree, "StoreNamedAttribute", data_type=data_type, domain="POINT")
        store("Name").default_value = name
        tree.links.new(captured(name), store("Value"))
        tree.links.new(geometry, store("Geometry"))
        geometry = stored("Geometry")
    tree.links.new(geometry, tree.nodes.new("NodeGroupOutput").inputs[0])
    return tree


def add_raycast(tree, target):
    """Add the Raycast node and what it takes; return its outputs by name.

    Object Info gives the target in its own space ("Original", the default), which is the rays' as well: both objects
    stay where they are made.
    """
    raycast, take, outputs = add_node(tree, "Raycast", data_type="INT")
    if hasattr(raycast, "mapping"):  # until Blender 4.5; a socket since 5.0
        raycast.mapping = "NEAREST"
    else:
        take("Interpolation").default_value = "Nearest"
    _, given, shown = add_node(tree, "ObjectInfo")
    given("Object").default_value = target
    tree.links.new(shown("Geometry"), take("Target Geometry"))
    for name, data_type, socket in (
        ("direction", "FLOAT_VECTOR", "Ray Direction"),
        ("reach", "FLOAT", "Ray Length"),
        ("face", "INT", "Attribute"),
    ):
        _, asked, named = add_node(tree, "InputNamedAttribute", data_type=data_type)
        asked("Name").default_value = name
        tree.links.new(named("Attribute"), take(socket))
    return outputs


def add_attribute(mesh, name, data_type, domain, values):
    """Store an array as an attribute of a mesh."""
    _, field, array_type, _ = TYPES[data_type]
    mesh.attributes.new(name, data_type, domain).data.foreach_set(field, values.astype(array_type).ravel())


def build(positions, triangles):
    """Build the node tree over the mesh, whose faces know their index.

    The node mixes the index from a face's corners with float32 weights, 1 at the nearest and 0 at the others: exact for
    fewer than 2^24 triangles. Rays live in Blender's data until the next ones are prepared.
    """
    import bpy

    scene, _, shown = show_mesh(positions, triangles, RAYCAST)
    target = shown.original
    add_attribute(target.data, "face", "INT", "FACE", np.arange(len(triangles)))
    if RAYCAST in bpy.data.node_groups:
        bpy.data.node_groups.remove(bpy.data.node_groups[RAYCAST])
    tree = make_tree(target)
    return Built(
        prepare=lambda origins, directions, reach: (scene, *show_rays(scene, tree, origins, directions, reach)),
        cast=cast,
        read=read,
        occlude=cast,
    )


def show_rays(scene, tree, origins, directions, reach):
    """Put the rays into the scene, as an object with the node tree; return (object, lengths of the directions)."""
    import bpy

    title = f"{RAYCAST}, rays"
    for collection in (bpy.data.objects, bpy.data.meshes):
        if title in collection:
            collection.remove(collection[title])
    lengths = np.linalg.norm(directions, axis=1)
    mesh = bpy.data.meshes.new(title)
    mesh.vertices.add(len(origins))
    mesh.vertices.foreach_set("co", origins.astype(np.float32).ravel())
    add_attribute(mesh, "direction", "FLOAT_VECTOR", "POINT", directions)
    add_attribute(mesh, "reach", "FLOAT", "POINT", np.minimum(reach * lengths, ANYWHERE))
    rays = bpy.data.objects.new(title, mesh)
    rays.modifiers.new(title, "NODES").node_group = tree
    scene.collection.objects.link(rays)
    return rays, lengths


def cast(prepared):
    """Evaluate the node tree again; return the directions' lengths and what it stored, name -> array."""
    scene, rays, lengths = prepared
    rays.update_tag(refresh={"DATA"})
    layer = scene.view_layers[0]
    layer.update()
    attributes = rays.evaluated_get(layer.depsgraph).data.attributes
    found = {}
    for name, (_, data_type) in FOUND.items():
        _, field, array_type, width = TYPES[data_type]
        found[name] = np.empty(len(lengths) * width, array_type)
        attributes[name].data.foreach_get(field, found[name])
    return lengths, found


def read(answered):
    """Translate the stored attributes; distances are metres along the normalized direction."""
    lengths, found = answered
    hit = found["hit"]
    t, primitive = miss_all(len(hit))
    t[hit] = found["distance"][hit] / lengths[hit]
    primitive[hit] = found["face"][hit]
    return Answer(t, primitive)


PEERS = {RAYCAST: load}
