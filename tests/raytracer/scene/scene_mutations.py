"""Scene files that are broken in one place, at random: bytes, the outline, the arrays, their headers."""

from __future__ import annotations

import copy
import io
import json
import zipfile
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

Generator = np.random.Generator
Arrays = dict[str, bytes]

# What stands in for a part of the outline; NaN and infinities are numbers to Python's JSON.
STRANGERS: tuple[Any, ...] = (
    *(None, True, "", "x", "\n", 0, -1, 0.5, 3, 2**31, 2**70, 1e-200, 1e20, 1e39, 1e300, float("nan"), float("inf")),
    *(float("-inf"), [], [[]], [1, 2], [1, 2, 3], [1e300] * 3, [float("inf")] * 3, ["a"], {}, {"a": 1}, {"array": 5}),
    *({"array": "array_0"}, {"array": "no"}, {"array": "outline"}, {"table": {}}, {"table": 5}, {"record": "Scene"}),
    *({"record": "Scene", "fields": {}}, {"record": "Scene", "fields": []}, {"record": [], "fields": {}}),
    *({"record": "World", "fields": {}}, {"record": "Program", "fields": {}}, {"record": "Image", "fields": {}}),
    {"record": "Register", "fields": {"step": 0, "output": "Value"}},
    {"record": "Register", "fields": {"step": 0.5, "output": "Value"}},
)
NUMBERS = (np.nan, np.inf, -np.inf, 1e300, -1e300, 1e39, 1e20, 1e-200, -1.0, 0.0, 5e-324)
HEADERS = (
    "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }",
    "{'descr': '|O', 'fortran_order': False, 'shape': (3,), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': ((((((3,), }",
    "{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': (3,), }",
    "((((" * 500,
    "'''",
    "",
)


def unpack(whole: bytes) -> tuple[Any, Arrays]:
    """Return the outline of a scene file, and its other entries by name."""
    with zipfile.ZipFile(io.BytesIO(whole)) as archive:
        entries = {name: archive.read(name) for name in archive.namelist()}
    return json.loads(str(np.load(io.BytesIO(entries.pop("outline.npy"))))), entries


def pack(outline: Any, arrays: Arrays, compression: int = zipfile.ZIP_DEFLATED) -> bytes:
    """Return a scene file of an outline, or of text in its place, and entries."""
    text = outline if isinstance(outline, str) else json.dumps(outline)
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", compression) as archive:
        for name, content in {"outline.npy": store(np.array(text)), **arrays}.items():
            archive.writestr(name, content)
    return file.getvalue()


def store(array: Any) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def list_places(outline: Any) -> list[tuple[Any, Any]]:
    """Return (container, key) of every part of an outline."""
    places, waiting = [], [outline]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict | list):
            keys = list(value) if isinstance(value, dict) else range(len(value))
            places += [(value, key) for key in keys]
            waiting += [value[key] for key in keys]
    return places


def mutate_outline(whole: bytes, rng: Generator) -> bytes:
    """Replace, remove, rename or double a part of the outline."""
    outline, arrays = unpack(whole)
    places = list_places(outline)
    container, key = places[rng.integers(len(places))]
    way = rng.integers(8)
    if way == 0 and isinstance(container, dict):
        del container[key]
    elif way == 1 and isinstance(container, dict):
        container[f"{key}x"] = container.pop(key)
    elif way == 2:
        container[key] = copy.deepcopy(places[rng.integers(len(places))][0])
    else:
        container[key] = copy.deepcopy(STRANGERS[rng.integers(len(STRANGERS))])
    return pack(outline, arrays)


def mutate_text(whole: bytes, rng: Generator) -> bytes:
    """Change a letter of the outline, cut it, or nest it."""
    outline, arrays = unpack(whole)
    text, way = json.dumps(outline), rng.integers(4)
    place = int(rng.integers(len(text)))
    if way == 0:
        text = text[:place]
    elif way == 1:
        depth = int(rng.integers(100, 200_000))
        text = '{"format": "reference-raytracer-scene-1", "scene": ' + "[" * depth + "]" * depth + "}"
    else:
        text = text[:place] + chr(rng.integers(32, 0xD7FF)) + text[place + 1 :]
    return pack(text, arrays)


def mutate_array(whole: bytes, rng: Generator) -> bytes:
    """Change numbers, the type or the shape of an array, or leave it out."""
    outline, arrays = unpack(whole)
    name = sorted(arrays)[rng.integers(len(arrays))]
    array, way = np.load(io.BytesIO(arrays[name])).copy(), rng.integers(6)
    if way == 0:
        del arrays[name]
        return pack(outline, arrays)
    if way == 1:
        array = array.astype(rng.choice(["<f4", "<i8", "|b1", "<U5", ">f8", "<c16", "<f2"]))
    elif way == 2:
        array = np.stack([array, array]) if rng.integers(2) else array.reshape(-1)
    elif array.dtype.kind == "f":
        with np.errstate(over="ignore"):
            array[rng.random(array.shape) < rng.choice([0.05, 1.0])] = NUMBERS[rng.integers(len(NUMBERS))]
    elif array.size:
        array.flat[rng.integers(array.size)] = rng.integers(-(2**31), 2**31) % (256 if array.itemsize == 1 else 2**31)
    arrays[name] = store(array)
    return pack(outline, arrays)


def mutate_header(whole: bytes, rng: Generator) -> bytes:
    """Change the header of an array, or how it is compressed."""
    outline, arrays = unpack(whole)
    name, way = sorted(arrays)[rng.integers(len(arrays))], rng.integers(4)
    if way == 0:
        return pack(outline, arrays, int(rng.choice([zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])))
    content = bytearray(arrays[name])
    if way == 1:
        content[rng.integers(min(128, len(content)))] = rng.integers(256)
    else:
        header = HEADERS[rng.integers(len(HEADERS))].encode() + b"\n"
        content[8:] = len(header).to_bytes(2, "little") + header + content[128:]
    return pack(outline, {**arrays, name: bytes(content)})


def mutate_bytes(whole: bytes, rng: Generator) -> bytes:
    """Change some bytes of the file, cut it or put others in its place."""
    if rng.integers(2):
        outline, arrays = unpack(whole)
        whole = pack(outline, arrays, zipfile.ZIP_STORED)
    changed, way = bytearray(whole), rng.integers(6)
    if way == 0:
        return whole[: rng.integers(len(whole))]
    if way == 1:
        return b"PK\x03\x04"[: rng.integers(5)] + rng.bytes(int(rng.integers(3000)))
    # Headers of entries and the directory at the end are where it hurts most.
    window = min(2000, len(changed)) if rng.integers(2) else len(changed)
    for _ in range(rng.integers(1, 20) if way == 2 else 1):
        changed[len(changed) - 1 - rng.integers(window)] ^= 1 << rng.integers(8)
    return bytes(changed)


MUTATIONS: tuple[Callable[[bytes, Generator], bytes], ...] = (
    *(mutate_outline, mutate_outline, mutate_outline, mutate_text, mutate_array, mutate_header, mutate_bytes),
)


def list_mutations(whole: bytes, count: int, seed: int) -> Iterator[tuple[str, bytes]]:
    """Yield (name, file) of `count` broken files."""
    for number in range(count):
        mutate = MUTATIONS[number % len(MUTATIONS)]
        yield f"{mutate.__name__} {number}", mutate(whole, np.random.default_rng((seed, number)))
