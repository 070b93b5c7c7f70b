"""Whether anybody still waits for what a job gives: the question that long functions ask in between.

Who runs a job says how to find out, without the job's function knowing whether it runs in a worker or beside its asker.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar


class DroppedError(Exception):
    """A job has ended early, for nobody waits for its result; what asks `is_dropped` raises it, or a kind of it."""


_question: ContextVar[Callable[[], bool]] = ContextVar("is_dropped", default=lambda: False)


def is_dropped() -> bool:
    """Return True once nobody waits for the job's result any more."""
    return _question.get()()


@contextmanager
def dropped_when(question: Callable[[], bool]) -> Iterator[None]:
    """Let `is_dropped` return what `question` does."""
    token = _question.set(question)
    try:
        yield
    finally:
        _question.reset(token)
