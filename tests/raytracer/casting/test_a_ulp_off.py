"""No certified hit depends on the machine's libm or BLAS: each is replaced by one that is an ulp off."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.folders import ROOT


def cast(*libraries: str) -> tuple[list[str], int]:
    """Return the hashes of decisions and distances with some libraries replaced, and how many results that moved."""
    command = [sys.executable, "-m", "tests.a_ulp_off", *libraries]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    *hashes, moved = done.stdout.split()
    return hashes, int(moved)


@pytest.fixture(scope="module")
def expected() -> list[str]:
    hashes, moved = cast()
    assert moved == 0
    return hashes


@pytest.mark.parametrize("library", ["libm", "blas", "linalg"])
def test_hits_are_the_same_with_a_library_that_is_an_ulp_off(expected: list[str], library: str) -> None:
    """Products by BLAS rule candidates out, by bounds for any order of sums, and decide nothing. Of LAPACK, nothing is
    called: matrices of instances are inverted by Cramer's rule."""
    hashes, moved = cast(library)
    assert (moved > 0) == (library != "linalg")
    assert hashes == expected
