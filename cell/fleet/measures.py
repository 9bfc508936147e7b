"""What two trees are compared by, and where each figure comes from."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

Row = Mapping[str, Any]


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


FLUENCY = "Hoffman 2019"

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
