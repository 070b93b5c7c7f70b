"""Hashes of hits and pictures, to compare machines: `python -m tests.digest.digest FOLDER [--write] [NAME ...]`.

FOLDER is what `tests.digest.export` wrote. For each scene there are two hashes: of its hits, which are the same on
every machine, and of its picture, which is the same wherever exp, log and pow round alike (README, *The same bits*).
They are compared with those of `hashes.json`; the exit code is 1 if one differs. --write keeps them there instead,
after a change that is meant to change pictures.

Needs neither Blender nor pytest.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import platform
import time
from pathlib import Path
from typing import Any

import numpy as np

import raytracer

KEPT = Path(__file__).with_name("hashes.json")
WIDTH, HEIGHT, SAMPLES = 36, 24, 2
RAYS = 4096
PASSES = ("Combined", "Depth", "Normal")
KINDS = ("hits", "picture")


def hash_arrays(*arrays: Any) -> str:
    """Return a hash of the arrays' types, shapes and bits, in the byte order of most machines."""
    made = hashlib.sha256()
    for array in map(np.ascontiguousarray, arrays):
        made.update(f"{array.dtype.kind}{array.dtype.itemsize}{array.shape}".encode())
        made.update(array.astype(array.dtype.newbyteorder("<")).tobytes())
    return made.hexdigest()[:16]


def hash_hits(scene: raytracer.Scene) -> str:
    """Return the hash of what certified rays hit: from around the camera into all directions.

    The rays are sums and products of random integers: they themselves are the same everywhere.
    """
    assert scene.camera is not None
    generator = np.random.default_rng(7)
    origins = scene.camera.world_from_camera[:3, 3] + generator.uniform(-2.0, 2.0, (RAYS, 3))
    directions = generator.uniform(-1.0, 1.0, (RAYS, 3))
    caster = raytracer.build(scene)
    hits = caster.closest_hit(origins, directions)
    found = (hits.instance, hits.primitive, hits.valid, hits.distance, hits.distance_error, hits.barycentric)
    return hash_arrays(*found, caster.any_hit(origins, directions, 0.0, 1.0), caster.crossings(origins, directions))


def hash_picture(scene: raytracer.Scene, settings: dict[str, Any]) -> str:
    """Return the hash of a small picture's passes."""
    film = raytracer.render(scene, WIDTH, HEIGHT, SAMPLES, passes=PASSES, **settings)
    return hash_arrays(*(film[name] for name in PASSES))


def digest(folder: Path, name: str) -> dict[str, str]:
    """Return the hashes of a scene."""
    scene = raytracer.load(folder / f"{name}.npz")
    settings = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    return {"hits": hash_hits(scene), "picture": hash_picture(scene, settings)}


def read_kept() -> dict[str, dict[str, str]]:
    """Return the hashes that are kept, by scene."""
    kept: dict[str, dict[str, str]] = json.loads(KEPT.read_text(encoding="utf-8")) if KEPT.exists() else {}
    return kept


def main() -> int:
    """Digest the scenes; print a line for each; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("scenes", nargs="*", help="all, if none is named")
    parser.add_argument("--write", action="store_true", help="keep the hashes")
    arguments = parser.parse_args()
    names = arguments.scenes or sorted(path.stem for path in arguments.folder.glob("*.npz"))
    kept, found, different = read_kept(), {}, dict.fromkeys(KINDS, 0)
    print(
        f"digest: {platform.system()} {platform.machine()}, Python {platform.python_version()}, NumPy {np.__version__}"
    )
    for name in names:
        started = time.perf_counter()
        found[name] = digest(arguments.folder, name)
        marks = {kind: found[name][kind] == kept.get(name, {}).get(kind) for kind in KINDS}
        for kind in KINDS:
            different[kind] += not marks[kind]
        words = "  ".join(f"{kind} {found[name][kind]} {'same' if marks[kind] else 'DIFFERENT'}" for kind in KINDS)
        print(f"{name:20} {words}  {time.perf_counter() - started:.1f} s", flush=True)
    print(f"digest: {len(names)} scenes; different: {different['hits']} in hits, {different['picture']} in pictures")
    if arguments.write:
        KEPT.write_text(json.dumps(kept | found, indent=1, sort_keys=True) + "\n", encoding="utf-8")
        return 0
    return int(any(different.values()) or not names)


if __name__ == "__main__":
    raise SystemExit(main())
