"""Comparisons that decide: who compares notes the parameter, the value measured, the limit and where that comes from.

`compared` answers as the bare comparison would, and costs no more where nobody collects.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from typing import Any

RELATIONS: Mapping[str, Callable[[Any, Any], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


@dataclass(frozen=True)
class Cause:
    """One comparison.

    Attributes:
        by: who compared: path of a node, or "guard", "supervisor bench_stale", "planner grasp".
        parameter: name of the limit, with its unit: "distance_m".
        measured, limit: in that unit; `holds` is the answer to `measured relation limit`.
        source: where the limit comes from: file and line of a tree, key of the configuration, constant of a module.
        of: what it was about, where one parameter is compared for several things: "o1 at p5".
        given: what somebody set that `measured` or `limit` depend on, by name.
    """

    by: str
    parameter: str
    measured: float
    relation: str
    limit: float
    holds: bool
    source: str = ""
    of: str = ""
    given: Mapping[str, float] = field(default_factory=dict)

    def __str__(self) -> str:
        """Like "distance_m of p4: 0.21 >= 0.25 is false"."""
        of = f" of {self.of}" if self.of else ""
        truth = str(self.holds).lower()
        return f"{self.parameter}{of}: {self.measured:.6g} {self.relation} {self.limit:.6g} is {truth}"

    def plain(self) -> dict[str, Any]:
        """As a log holds it: JSON has no number that is not finite, but its word."""
        given = {name: _finite(value) for name, value in self.given.items()}
        return {**vars(self), "measured": _finite(self.measured), "limit": _finite(self.limit), "given": given}

    @property
    def key(self) -> tuple[str, str, str]:
        """The same comparison in another tick has the same."""
        return self.by, self.parameter, self.of


class Causes:
    """Collects the comparisons of a tick; hands on those that answer otherwise than before."""

    def __init__(self) -> None:
        self._answers: dict[tuple[str, str, str], bool] = {}
        self._tick: dict[tuple[str, str, str], Cause] = {}

    def add(self, cause: Cause) -> None:
        """The last of a tick counts."""
        self._tick[cause.key] = cause

    def take(self) -> list[Cause]:
        """What changed since the last call, in the order of the first comparison in the tick."""
        answers = self._answers
        found = [cause for key, cause in self._tick.items() if answers.get(key) is not cause.holds]
        answers.update((cause.key, cause.holds) for cause in found)
        self._tick.clear()
        return found


def _finite(value: float) -> float | str:
    return value if math.isfinite(value) else str(value)


_COLLECTS: ContextVar[Causes | None] = ContextVar("causes", default=None)


@contextmanager
def collecting(causes: Causes | None) -> Iterator[None]:
    """Let comparisons of this thread be noted; None for what is only supposed, and decides nothing."""
    token = _COLLECTS.set(causes)
    try:
        yield
    finally:
        _COLLECTS.reset(token)


def compared(
    by: str | Callable[[], tuple[str, str]],
    parameter: str,
    measured: float,
    relation: str,
    limit: float,
    source: str = "",
    of: str = "",
    /,
    **given: float,
) -> bool:
    """Whether `measured relation limit`; noted where somebody collects.

    Args:
        by: who compares; a function gives it with the source, where these cost something to find.
        given: as in `Cause`; the limit itself where nothing is named.
    """
    holds = bool(RELATIONS[relation](measured, limit))
    if (causes := _COLLECTS.get()) is not None:
        if callable(by):
            by, source = by()
        causes.add(
            Cause(
                by, parameter, float(measured), relation, float(limit), holds, source, of, given or {parameter: limit}
            )
        )
    return holds
