"""Runs one pick and place with one fault, and measures how the cell stopped or recovered."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cell.configuration import load_configuration, load_faults, load_product
from cell.interfaces.files import shipped
from cell.interfaces.judgement import Action
from cell.interfaces.observation import STANDING_RAD_S
from cell.interfaces.perception import Frame
from cell.observer import Level, Outcome, TickRecord
from cell.run import Files, drive
from cell.running.injection import FAULTS, STATES, Injection
from cell.running.node_library import node_registry
from cell.running.services import load_planners
from sim.cell import SimCell
from skills.planner import MotionPlanner
from trees.files.loader import load_tree

HOLDING_STATES = ("lift", "carry", "lower")
LIFTED_M = 0.003
Row = dict[str, object]


@dataclass
class Watch:
    """An observer that measures from the fault on.

    Attributes:
        ticks_to_stop: from the first tick that could see the fault until the supervisor held or stopped; -1 for never.
        stop_s, stop_m: from the fault until the arm stood, as measured at 500 Hz.
    """

    injection: Injection
    motion: MotionPlanner
    ticks_to_stop: int = -1
    stop_s: float = 0.0
    stop_m: float = 0.0
    held_before: bool = False
    _ticks: int = 0
    _rested: bool = False
    _tool: list[np.ndarray] = field(default_factory=list)

    def frame(self, frame: Frame) -> None:
        """Images are not looked at."""

    def tick(self, record: TickRecord) -> None:
        began_s = self.injection.began_s
        if began_s is None:
            self.held_before = record.observation.gripper.holding
            return
        self._measure(record, began_s)
        if record.observation.time_s <= began_s:
            return
        self._ticks += 1
        acts = record.judgement is not None and record.judgement.action >= Action.HOLD
        if self.ticks_to_stop < 0 and (acts or record.status == "STOPPING"):
            self.ticks_to_stop = self._ticks

    def message(self, time_s: float, level: Level, text: str) -> None:
        """Messages are not kept."""

    def close(self, outcome: Outcome) -> None:
        """Nothing to do."""

    def _measure(self, record: TickRecord, began_s: float) -> None:
        if record.joints is None or self._rested:
            return
        joints = record.joints
        for time_s, positions, speeds in list(
            zip(joints.times_s, joints.positions_rad, joints.velocities_rad_s, strict=True)
        )[::4]:
            if time_s <= began_s:
                continue
            self._tool.append(np.array(self.motion.kinematics.forward(positions).position_m))
            if len(self._tool) > 1:
                self.stop_m += float(np.linalg.norm(self._tool[-1] - self._tool[-2]))
            self.stop_s = float(time_s) - began_s
            if np.abs(speeds).max() < STANDING_RAD_S and self.ticks_to_stop >= 0:
                self._rested = True
                return


def pairs(faults: Sequence[str] | None, states: Sequence[str] | None) -> Iterator[tuple[str, str]]:
    """All pairs of the given faults and states, or of all; raises InputError for a name that there is not."""
    for fault in faults or FAULTS:
        for state in states or STATES:
            Injection(fault, state)
            yield fault, state


def fault_row(path: Path, fault: str, state: str, seeds: Sequence[int]) -> Row:
    """All tries of one pair; figures are the worst of them."""
    tries = [fault_try(path, fault, state, seed) for seed in seeds]
    worst = max(tries, key=lambda one: (not one["as_promised"], one["stop_s"]))
    ends = sorted({str(one["end"]) for one in tries})
    return {
        **worst,
        "tries": len(tries),
        "end": " or ".join(ends),
        "as_promised": all(bool(one["as_promised"]) for one in tries),
        "recovered": sum(bool(one["recovered"]) for one in tries),
    }


def fault_try(path: Path, fault: str, state: str, seed: int) -> Row:
    """One run of the robot alone: fetch a part and put it into a hole, with the fault on the way."""
    configuration = load_configuration(path)
    product = load_product(configuration, path)
    motion = MotionPlanner(product, configuration.bench, configuration.motion)
    tree = load_tree(shipped("trees", "commission.xml"), node_registry())
    files = Files(configuration, product, tree, load_planners(configuration, product), load_faults(configuration))
    can = configuration.gripper_can
    goal = sorted(product.goals)[0]
    simulation = configuration.devices.simulation
    cell = SimCell(product, configuration.bench, simulation, can.interface, can.channel, seed, goal, worker=False)
    injection = Injection(fault, state)
    watch = Watch(injection, motion)
    try:
        outcome = drive(files, cell.devices, motion, [watch], injection=injection)
        placed = any(one.seated and one.by == "robot" for one in cell.score.placements().values())
        hangs = _hangs(cell)
    finally:
        cell.close()
    reached = injection.began_s is not None
    kept = hangs if watch.held_before and outcome.end != "finished" and state in HOLDING_STATES else None
    promised = reached and outcome.end in FAULTS[fault].ends and kept is not False
    return {
        "fault": fault,
        "state": state,
        "seed": seed,
        "reached": reached,
        "end": outcome.end,
        "exit_status": outcome.exit_status,
        "reason": outcome.reason,
        "condition": outcome.condition,
        "ticks_to_stop": watch.ticks_to_stop,
        "stop_s": round(watch.stop_s, 3) if watch.ticks_to_stop >= 0 else 0.0,
        "stop_m": round(watch.stop_m, 3) if watch.ticks_to_stop >= 0 else 0.0,
        "held": kept,
        "recovered": outcome.end == "finished" and placed,
        "contact_m_s": 0.0,
        "as_promised": promised,
    }


def _hangs(cell: SimCell) -> bool:
    """Whether a part hangs above where parts stand, in truth."""
    floor_m = cell.world.bench.tray.centre_m[2]
    pegs = {name: part.peg_length_m for name, part in cell.world.product.parts.items()}
    heights = [cell.world.data.xpos[body.body][2] - floor_m - pegs[body.part] for body in cell.world.bodies]
    return bool(max(heights, default=0.0) > LIFTED_M)
