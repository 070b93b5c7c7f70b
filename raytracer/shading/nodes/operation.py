"""Operations of programs: functions on arrays, with the sockets and properties of Blender's nodes that feed them."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def read_no_attributes(settings: Mapping[str, Any]) -> tuple[str, ...]:
    return ()


@dataclass(frozen=True)
class Operation:
    """One row of the table of operations.

    compute : called with the site if `reads_site`, then the inputs in order, then the settings by name. Numbers come
        as () or (n,), vectors and colors as (3,) or (n, 3), float64; what it returns may be of either shape
    inputs, outputs : identifiers of the node's sockets; an operation of several outputs returns them in order
    settings : names of the node's properties, or of what the add-on makes of them
    reads_site : False for a pure function, which is computed once where all its inputs are constant
    runs_programs : True where a setting is a program; `compute` is then also given `evaluate`, which runs one at a site
    links : for an input that nothing is linked to, the operation that feeds it instead of the socket's own value
    attributes : the names of the mesh attributes read, from the settings
    choices : for settings that choose among functions, the values that there are
    """

    compute: Callable[..., Any]
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ("Value",)
    settings: tuple[str, ...] = ()
    reads_site: bool = False
    runs_programs: bool = False
    links: Mapping[str, str] = field(default_factory=dict)
    attributes: Callable[[Mapping[str, Any]], tuple[str, ...]] = read_no_attributes
    choices: Mapping[str, Collection[str]] = field(default_factory=dict)


def spread(numbers: Any) -> Array:
    """Return numbers (...) as (..., 1), to be combined with vectors (..., 3)."""
    return np.asarray(numbers, dtype=np.float64)[..., np.newaxis]


def stack(*components: Any) -> Array:
    """Return vectors (..., k) of k components that broadcast."""
    return np.stack(np.broadcast_arrays(*components), axis=-1)


def saturate(values: Any) -> Array:
    """Return values cut to the range from 0 to 1."""
    return np.clip(values, 0.0, 1.0)


def mix(first: Any, second: Any, factor: Any) -> Any:
    """Return first + (second - first) factor."""
    return first + (second - first) * factor


def divide(dividend: Any, divisor: Any) -> Array:
    """Return dividend / divisor, 0 where the divisor is 0."""
    dividend, divisor = np.broadcast_arrays(np.asarray(dividend, float), np.asarray(divisor, float))
    return np.divide(dividend, divisor, out=np.zeros_like(dividend), where=divisor != 0)
