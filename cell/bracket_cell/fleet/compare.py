"""Two trees compared run by run, paired by seed: what is better, and what is not proved to be."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from bracket_cell.fleet.intervals import Interval, paired_mean, paired_share
from bracket_ground.errors import InputError

Row = Mapping[str, Any]
FLUENCY = "Hoffman 2019"
Verdict = Literal["better", "worse", "differs", "no difference proved", "too few pairs"]
LEVEL = 0.95
SAME = ("seed", "goal_asked", "person", "look", "fault")  # two runs are a pair where these are alike
FEWEST_PAIRS = 6  # of which a sign test at 5 % can prove anything: 2 / 2 ** 6 < .05
_LIMIT = re.compile(r"\s*(\w+)\s*([<>])\s*([-+]?\d+(?:\.\d+)?)\s*(%?)\s*")


@dataclass(frozen=True)
class Measure:
    """One figure of a run.

    Attributes:
        better: "more" or "less" is better; "" where neither is.
        judged: it decides which tree is better; the others explain.
        of: its value in a row; None where the run does not have it.
    """

    name: str
    what: str
    better: Literal["more", "less", ""]
    of: Callable[[Row], float | bool | None]
    judged: bool = False
    unit: str = ""


def _of(key: str) -> Callable[[Row], float | None]:
    def value(row: Row) -> float | None:
        found = row.get(key)
        return None if found is None else float(found)

    return value


def _finished(row: Row) -> bool:
    return row.get("end") == "finished"


MEASURES = (
    Measure("right", "finished, and the bracket is right", "more",
            lambda row: _finished(row) and bool(row.get("correct")), True),
    Measure("wrong", "brackets with a wrong placement", "less",
            lambda row: bool(row.get("wrong_placements")), True),
    Measure("time_s", "time for a bracket", "less",
            lambda row: float(row["sim_time_s"]) if _finished(row) else None, True, "s"),
    Measure("robot_parts", "parts placed by the robot", "", _of("robot_placements")),
    Measure("questions", "calls for help", "less", _of("help_requests")),
    Measure("contacts", "contacts of hand and robot", "less", _of("contacts")),
    Measure("interventions", "times that the supervisor held the arm or stopped it", "less", _of("interventions")),
    Measure("held_s", "time that the supervisor held the arm", "less", _of("held_s"), unit="s"),
    Measure("slowed_s", "time that the arm lost by being slowed", "less", _of("slowed_s"), unit="s"),
    Measure("lost_alone_s", "of both, while the person rests", "less", _of("lost_alone_s"), unit="s"),
    Measure("moves", "motions of the arm", "less", _of("moves")),
    Measure("least_distance_m", "least distance of hand and tool on the bench while the arm moves", "more",
            _of("least_distance_m"), unit="m"),
    Measure("human_waits_s", "time that the person rests", "less", _of("human_waits_s"), unit="s"),
    Measure("robot_waits_s", "time that the robot stands", "less", _of("robot_waits_s"), unit="s"),
    Measure("human_idle", f"H-IDLE ({FLUENCY}): share of the time that the person rests", "less", _of("human_idle")),
    Measure("robot_idle", f"R-IDLE ({FLUENCY}): share of the time that the robot stands", "less", _of("robot_idle")),
    Measure("concurrent", f"C-ACT ({FLUENCY}): share of the time that both act", "more", _of("concurrent")),
    Measure("functional_delay", f"F-DEL ({FLUENCY}): share of the time between one's action and the other's", "less",
            _of("functional_delay")),
)  # fmt: skip
BY_NAME = {measure.name: measure for measure in MEASURES}


@dataclass(frozen=True)
class Finding:
    """One measure of both.

    Attributes:
        one, other: means, shares for yes and no.
        difference: other minus one, with its interval.
        pairs: how many had a value in both.
    """

    measure: Measure
    one: float
    other: float
    difference: Interval
    pairs: int

    @property
    def verdict(self) -> Verdict:
        if self.pairs < FEWEST_PAIRS:
            return "too few pairs"
        if not self.difference.proved:
            return "no difference proved"
        if not self.measure.better:
            return "differs"
        more = self.difference.low > 0
        return "better" if more == (self.measure.better == "more") else "worse"


@dataclass(frozen=True)
class Limit:
    """A bound that a difference must keep, as "right < -2%": it fails where the difference is below.

    Attributes:
        of_one: the bound is a share of the first one's value.
    """

    measure: Measure
    sign: Literal["<", ">"]
    bound: float
    of_one: bool
    text: str

    @staticmethod
    def parse(text: str) -> Limit:
        """Raises: InputError: it is none."""
        found = _LIMIT.fullmatch(text)
        if found is None or found[1] not in BY_NAME:
            legal = ", ".join(BY_NAME)
            raise InputError(f"--fail-if {text!r} is not a bound like 'right < -2%' or 'time_s > 3'; legal: {legal}")
        measure = BY_NAME[found[1]]
        bound = float(found[3]) / (100 if found[4] else 1)
        share = measure.name in ("right", "wrong")  # points of a share, not a share of it
        return Limit(measure, "<" if found[2] == "<" else ">", bound, bool(found[4]) and not share, text)

    def broken(self, findings: Iterable[Finding]) -> bool:
        """Whether the measured difference is beyond the bound; also where nothing could be measured."""
        finding = next(finding for finding in findings if finding.measure is self.measure)
        value, bound = finding.difference.value, self.bound * (finding.one if self.of_one else 1.0)
        if math.isnan(value):
            return True
        return value < bound if self.sign == "<" else value > bound


def pair(ones: Iterable[Row], others: Iterable[Row]) -> list[tuple[Row, Row]]:
    """Runs of the same seed, person, goal, look and fault; what has no partner is left out."""
    by_what = {_what(row): row for row in ones}
    return [(by_what[what], row) for row in others if (what := _what(row)) in by_what]


def findings(pairs: Sequence[tuple[Row, Row]]) -> list[Finding]:
    """Every measure. Those that decide share the risk of a false alarm among them (Bonferroni)."""
    judged = sum(measure.judged for measure in MEASURES)
    return [_finding(measure, pairs, 1 - (1 - LEVEL) / (judged if measure.judged else 1)) for measure in MEASURES]


def overall(found: Iterable[Finding]) -> Literal["better", "worse", "mixed", "no difference proved"]:
    """What the measures that decide say together."""
    verdicts = {finding.verdict for finding in found if finding.measure.judged}
    if {"better", "worse"} <= verdicts:
        return "mixed"
    return "better" if "better" in verdicts else "worse" if "worse" in verdicts else "no difference proved"


def differing(pairs: Iterable[tuple[Row, Row]]) -> list[tuple[Row, Row]]:
    """Pairs whose runs came out otherwise, the greatest difference of time first; failures before all."""
    keys = ("end", "correct", "wrong_placements", "help_requests", "contacts", "sim_time_s")
    other = [(a, b) for a, b in pairs if any(a.get(key) != b.get(key) for key in keys)]
    return sorted(other, key=_weight, reverse=True)


def _weight(two: tuple[Row, Row]) -> tuple[bool, bool, float]:
    a, b = two
    other_result = (a.get("end"), a.get("correct")) != (b.get("end"), b.get("correct"))
    wrong = a.get("wrong_placements") != b.get("wrong_placements")
    return other_result, wrong, abs(float(b.get("sim_time_s") or 0) - float(a.get("sim_time_s") or 0))


def _what(row: Row) -> tuple[object, ...]:
    return tuple(row.get(name) or "" for name in SAME)


def _finding(measure: Measure, pairs: Sequence[tuple[Row, Row]], level: float) -> Finding:
    values = [(measure.of(a), measure.of(b)) for a, b in pairs]
    known = [(a, b) for a, b in values if a is not None and b is not None]
    ones, others = [a for a, _ in known], [b for _, b in known]
    shares = bool(known) and isinstance(ones[0], bool)
    if shares:
        difference = paired_share([bool(one) for one in ones], [bool(other) for other in others], level)
    else:
        difference = paired_mean([float(one) for one in ones], [float(other) for other in others], level)
    return Finding(measure, _mean(ones), _mean(others), difference, len(known))


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values) if values else math.nan
