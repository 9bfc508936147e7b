"""What stands in the holes, and what was placed there when: fingers open over a hole, or a part slips out of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bracket_ground.interfaces.devices import TruthEvent
from bracket_ground.interfaces.pose import Array
from bracket_sim.worker.worker_sight import NEAR_HOLE_M, SEATED_TILT_RAD

if TYPE_CHECKING:
    from bracket_lab.drawing.recording import Assembly, Moment, Source

STAYS_S = 1.0  # what came to stand in a hole was placed there if it was empty for so long, and then is not
Placed = tuple[int, str, str]  # number of the moment, part and position


def holes_of(source: Source, moment: Moment) -> dict[str, tuple[str | None, bool]]:
    """Type of the part in or on each hole, and whether it is upright, in truth."""
    found: dict[str, tuple[str | None, bool]] = {}
    bracket = source.bench.bracket.pose
    for position, xy in source.product.bracket.holes_m.items():
        hole: Array = bracket.transform(np.array([*xy, 0.0]))
        off = np.linalg.norm(moment.parts_m[:, :2] - hole[:2], axis=1)
        low = np.abs(moment.parts_m[:, 2] - hole[2]) < NEAR_HOLE_M
        inside = np.flatnonzero((off < NEAR_HOLE_M) & low)
        if not len(inside):
            found[position] = (None, True)
            continue
        nearest = int(inside[off[inside].argmin()])
        upright = bool(moment.upright[nearest] > math.cos(SEATED_TILT_RAD))
        found[position] = (source.assembly.world.bodies[nearest].part, upright)
    return found


def placed(source: Source) -> list[Placed]:
    """All that the person placed, in order: when the fingers had opened, and the part stood in its hole."""
    assembly, stays = source.assembly, _stays(source)
    found = [] if assembly.robot_works else slipped(source)
    for number, part, position in releases(assembly):
        later = range(number, min(number + stays, len(assembly.moments)))
        stands = (at for at in later if assembly.held[at] != part and _at(source, at, position) == (part, True))
        found.append((next(stands, number), part, position))
    return sorted(found)


def releases(assembly: Assembly) -> list[Placed]:
    """Number of each moment when fingers opened over a hole, and what was let go there: part and position."""
    found, opened = [], False
    for number, label in enumerate(assembly.labels):
        if label.released and not opened and label.part and label.position:
            found.append((number, label.part, label.position))
        opened = label.released
    return found


def slipped(source: Source) -> list[Placed]:
    """Parts that came to stand in a hole although nobody opened the fingers for it: moment, part and position.

    By physics a part may slip out of the fingers into the hole that it was meant for, or lean there until it is pressed
    home: it was placed when it stands and the hand has let go of it.
    """
    assembly = source.assembly
    stays = _stays(source)
    let_go, found = releases(assembly), list[Placed]()
    stands = [holes_of(source, moment) for moment in assembly.moments]
    for number in range(stays, len(stands) - stays):
        for position, now in stands[number].items():
            part, came = now[0], number
            if part is None or assembly.held[number] == part:
                continue
            while came > 0 and _comes(part, stands[came - 1][position], assembly.held[came - 1]):
                came -= 1
            rests = now == stands[number + stays][position] == (part, True)
            empty = came >= stays and all(before[position][0] is None for before in stands[came - stays : came])
            reported = any(act[1:] == (part, position) and came - stays <= act[0] <= number + stays for act in let_go)
            found += [(number, part, position)] if rests and empty and not reported else []
    return found


def with_slips(acts: Sequence[TruthEvent], source: Source) -> list[TruthEvent]:
    """What the person did, where fingers that held nothing any more let go of what had slipped out of them.

    A person who is asked what was placed says the same, whether the part left the fingers a moment before they opened,
    or fell and stood a moment later.
    """
    events = list(acts)
    for number, part, position in slipped(source):
        slipped_s = source.assembly.moments[number].time_s
        away_s = {index: abs(act.time_s - slipped_s) for index, act in enumerate(events) if _of_nothing(act)}
        nearest = min(away_s, key=away_s.__getitem__, default=None)
        if nearest is not None and away_s[nearest] <= STAYS_S:
            act = events[nearest]
            events[nearest] = replace(act, fields={**act.fields, "part": part, "position": position})
    return events


def _of_nothing(act: TruthEvent) -> bool:
    return act.fields.get("act") == "release" and act.fields.get("part") is None


def _stays(source: Source) -> int:
    return round(STAYS_S * source.bench.overhead.rate_hz)


def _at(source: Source, number: int, position: str) -> tuple[str | None, bool]:
    return holes_of(source, source.assembly.moments[number])[position]


def _comes(part: str, now: tuple[str | None, bool], held: str | None) -> bool:
    """Whether a part is in a hole, and leans there or is held yet."""
    return now[0] == part and (not now[1] or held == part)
