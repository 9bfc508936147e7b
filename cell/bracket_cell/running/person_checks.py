"""What the supervisor looks for between arm and person: the distance to hands, and where nobody sees who comes."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from bracket_cell.running.fault_checks import Check, FaultReport, Memory
from bracket_cell.skills.motion.known_bench import Implausible, KnownBench
from bracket_cell.skills.motion.near_hand import separation_of
from bracket_cell.skills.motion.separation import UNKNOWN, Following, Separation, SeparationMonitor
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.observation import Observation
from btxml.engine.causes import compared


@dataclass(frozen=True)
class ApproachLimits:
    """How long a near hand is remembered. Origin: chosen: four frames of a camera with 15 Hz.

    Attributes:
        lately_s: [s] whose fastest motion decides on a hold for a near hand.
    """

    lately_s: float = 0.3


LIMITS = ApproachLimits()


SOURCE = "configuration, motion.separation"


def person_checks(monitor: SeparationMonitor) -> dict[str, Check]:
    """Checks that need to know the arm's outline."""
    known: list[tuple[int, Separation | None]] = [(-1, None)]
    given = {name: value for name, value in monitor.settings.model_dump().items() if isinstance(value, float)}

    def separation(seen: Observation, memory: Memory) -> Separation | None:
        if known[0][0] != seen.tick:
            known[0] = (seen.tick, separation_of(monitor, seen, _followed(seen, memory)))
        return known[0][1]

    def not_plausible(seen: Observation, _: Command, __: Memory) -> FaultReport | None:
        words = "" if seen.bench is None else monitor.persons.view_range.doubt(seen.bench, seen.time_s)
        return FaultReport(words) if words else None

    def near(seen: Observation, _: Command, memory: Memory) -> FaultReport | None:
        now = separation(seen, memory)
        if now is None or compared("supervisor hand_near", "full_share", now.speed_scale, ">=", 1.0, SOURCE, **given):
            return None
        return FaultReport("slower, as a hand is near", now.speed_scale)

    def too_near(seen: Observation, _: Command, memory: Memory) -> FaultReport | None:
        found = separation(seen, memory)
        if found is None:
            memory.too_near, memory.leasts_m = False, ()
            return None
        lately = ((at_s, least_m) for at_s, least_m in memory.leasts_m if at_s > seen.time_s - LIMITS.lately_s)
        memory.leasts_m = (*lately, (seen.time_s, found.least_m))
        least_m, slack_m = found.least_m, monitor.settings.hysteresis_m
        if memory.too_near:
            least_m = max(least_m for _, least_m in memory.leasts_m) + slack_m
        memory.too_near = not compared(
            "supervisor hand_too_near", "least_m", found.distance_m, ">=", least_m, SOURCE, **given
        )
        if not memory.too_near:
            return None
        if not found.distance_m >= found.least_m + slack_m:  # else only a motion before asks for more room
            memory.retreat_scale = found.retreat_scale
        words = "the hand is too near" + "; the arm moves away from it, slowly" * (memory.retreat_scale > 0)
        words = "it is not known how near a hand is" if found is UNKNOWN else words
        return FaultReport(words, retreat_scale=memory.retreat_scale)

    def blind(seen: Observation, _: Command, __: Memory) -> FaultReport | None:
        view, joints = seen.bench, seen.arm.known_rad(monitor.outline.joints)
        with suppress(Implausible):
            if (
                view is not None
                and KnownBench(monitor.persons.view_range, view, seen.time_s).count >= monitor.persons.hands
            ):
                return None
        if joints is not None and not monitor.out_of_view(np.array(joints)):
            return None
        return FaultReport("slower, as the camera does not see who comes here", monitor.settings.blind_share)

    return {"hand_not_plausible": not_plausible, "hand_near": near, "hand_too_near": too_near, "blind_area": blind}


def _followed(seen: Observation, memory: Memory) -> Following | None:
    """The trajectory that the arm follows, and how far along it is."""
    path_s = seen.arm.path_s
    if memory.trajectory is None or path_s is None or (not seen.arm.moving and seen.arm.stands):
        return None
    return memory.trajectory, path_s
