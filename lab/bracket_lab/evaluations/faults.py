"""Every fault in every state: a pick and place of the robot alone runs once, and splits where a state is reached.

At that moment the process forks once for each fault. The child goes on with the fault to the end of its run, and says
how it ended; the parent goes on without one to the next state. So what leads to a state is computed once.
Forking needs a process without a graphics context: nothing is rendered, `ground_truth_perception` answers in place of
pixels.
"""

from __future__ import annotations

import json
import os
import signal
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import cv2

from bracket_cell.configuration import load_configuration, load_faults, load_product
from bracket_cell.running.supervisor import Supervisor, make_supervisor
from bracket_cell.runs.options import Files
from bracket_cell.runs.run import run_controller
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.watching.observer import Observer, Outcome, TickRecord
from bracket_cell.watching.work_state import OTHER_STATES, STATES
from bracket_cell.wiring.detectors import with_detectors_for
from bracket_cell.wiring.devices import attached
from bracket_cell.wiring.services import load_planners
from bracket_ground.files.row_store import Row
from bracket_ground.interfaces.faults import FaultTable
from bracket_lab.evaluations.assembly import Assembly, Injected
from bracket_lab.evaluations.danger import Drops, StoppingDistance
from bracket_sim.cell import SimCell
from bracket_sim.faults.injection import Injection
from bracket_sim.faults.named_faults import AS_DATA, FAULTS, FaultKind, signals_of
from bracket_sim.process.no_render_host import without_pixels
from bracket_sim.scene.settings import settings_of

HOLDING_STATES = ("lift", "carry", "lower")
LIFTED_M = 0.003
TRIAL = Path(__file__).with_name("trial.xml")  # tree of a trial
LONGEST_S = 240.0  # of a trial, in simulated time: 20 s without a fault; what waits for a person ends after 120 s
HANGS_S = 600  # of a trial, by the wall
EVERY_STATE = ("idle", *STATES, "waiting_for_help")
assert {*EVERY_STATE} == {*STATES, *OTHER_STATES}
Pairs = Mapping[str, Sequence[str]]


def chosen(faults: Sequence[str] | None, states: Sequence[str] | None, joints: int | None = None) -> Pairs:
    """Faults by state: those that are named, or all; raises InputError for one that there is not in such an arm."""
    for fault in faults or ():
        signals_of(fault, joints)
        for state in states or ():
            Injection(fault, state)
    pairs = {state: tuple(name for name in faults or FAULTS if _comes(name, state)) for state in states or EVERY_STATE}
    return {state: names for state, names in pairs.items() if names}


def _comes(fault: str, state: str) -> bool:
    """Whether it can come in this state."""
    kind = FAULTS.get(fault)
    return kind is None or not kind.states or state in kind.states


def left(pairs: Pairs, rows: Sequence[Row], seed: int, first_seed: int) -> Pairs:
    """The pairs that still have to be run with this seed: where nothing moves, one run is enough."""
    done = {(row["fault"], row["state"]) for row in rows if row["seed"] == seed}
    states = {state: names for state, names in pairs.items() if seed == first_seed or state not in OTHER_STATES}
    missing = {state: [name for name in names if (name, state) not in done] for state, names in states.items()}
    return {state: names for state, names in missing.items() if names}


def merged(rows: Sequence[Row]) -> list[Row]:
    """A row for each fault in each state; figures are the worst of its tries."""
    tries: dict[tuple[object, object], list[Row]] = {}
    for row in rows:
        tries.setdefault((row["fault"], row["state"]), []).append(row)
    return [_worst(found) for found in tries.values()]


def _worst(rows: Sequence[Row]) -> Row:
    worst = max(rows, key=lambda row: (not row["as_promised"], row["ticks_to_stop"], row["stop_s"]))
    return {
        **worst,
        "tries": len(rows),
        "end": " or ".join(sorted({str(row["end"]) for row in rows})),
        "as_promised": all(bool(row["as_promised"]) for row in rows),
        "recovered": sum(bool(row["recovered"]) for row in rows),
        "recoverable": sum(bool(row["recoverable"]) for row in rows),
    }


def totals(rows: Sequence[Row]) -> Row:
    """Of all tries: how many ended as promised, recovered and kept their part, and how soon they stopped."""
    rows = [row for row in rows if row["fault"] != "none"]
    could = [row for row in rows if row["recoverable"]]
    parts = [row for row in rows if row["held"] is not None]
    ticks = Counter(int(str(row["ticks_to_stop"])) for row in rows)
    return {
        "tries": len(rows),
        "ended_as_promised": sum(bool(row["as_promised"]) for row in rows),
        "recoverable": len(could),
        "recovered": sum(bool(row["recovered"]) for row in could),
        "parts_held": len(parts),
        "parts_kept": sum(bool(row["held"]) for row in parts),
        "by_ticks_to_stop": {str(number): ticks[number] for number in sorted(ticks)},
        "most_stop_m": max((float(str(row["stop_m"])) for row in rows), default=0.0),
    }


class Fork(Injection):
    """A run that splits: a process for each fault goes on from here with it.

    Attributes:
        child: this process carries a fault.
    """

    def __init__(self, state: str, seed: int) -> None:
        super().__init__("", state)
        self.seed, self.child, self._answer = seed, False, -1

    def split(self, fault: str) -> Row | None:
        """Split for a fault: None in the process that is to go on with it, in the other what that one answers.

        A child that does not answer hung, or something ended it.
        """
        reading, writing = os.pipe()
        process = os.fork()
        if not process:
            os.close(reading)
            signal.alarm(HANGS_S)
            self.child, self._answer = True, writing
            return None
        os.close(writing)
        try:
            with os.fdopen(reading) as answer:
                text = answer.read()
        except KeyboardInterrupt:  # nobody waits for the child any more
            os.kill(process, signal.SIGKILL)
            raise
        finally:
            _, status = os.waitpid(process, 0)
        found: Row = json.loads(text) if text else _broken(fault, self.state, self.seed, status)
        return found

    def reply(self, row: Row) -> None:
        """The child is done; it ends without a word to anybody else."""
        os.write(self._answer, json.dumps(row).encode())
        os._exit(0)


class StateFork(Fork):
    """Splits the run at every state.

    Attributes:
        left: states that did not come so far.
    """

    def __init__(self, pairs: Pairs, seed: int, tell: Callable[[Row], None]) -> None:
        super().__init__(next(iter(pairs)), seed)
        self.left, self._tell = dict(pairs), tell

    def tick(self, record: TickRecord) -> None:
        """A state that is wanted and has come is the next one."""
        if self.began_s is None and self._work.name in self.left:
            self.state = self._work.name
        super().tick(record)

    def reached(self, time_s: float) -> None:
        """One child for each fault, one after the other."""
        for fault in self.left.pop(self.state):
            row = self.split(fault)
            if row is None:
                self.left = {}
                self.begin(fault, time_s)
                return
            self._tell(row)


def fast_rows(path: Path, pairs: Pairs, seed: int, tell: Callable[[Row], None]) -> None:
    """Tell how each fault ended in each state, from one run that splits; at last, how that one ended without a fault.

    A state that never came is reported, too, as a row that is not as promised.
    """
    fork = StateFork(pairs, seed, tell)
    row = _tried(path, fork, seed, rendered=False)
    if fork.child:
        fork.reply(row)
    for state in fork.left:
        tell({**row, "fault": "none", "state": state, "reached": False, "as_promised": False})
    tell({**row, "fault": "none", "state": "none"})


def fast_list(path: Path, pairs: Pairs, seed: int) -> list[Row]:
    """The rows that `fast_rows` tells."""
    rows: list[Row] = []
    fast_rows(path, pairs, seed, rows.append)
    return rows


def fault_try(path: Path, fault: str, state: str, seed: int, *, rendered: bool = True) -> Row:
    """One run of the robot alone with one fault: rest, fetch a part, put it into a hole, call for help."""
    return _tried(path, Injection(fault, state), seed, rendered=rendered)


def _tried(path: Path, injection: Injection, seed: int, *, rendered: bool) -> Row:
    with trial(path, seed, rendered=rendered) as opened:
        watch, drops = StoppingDistance(injection, opened.motion), Drops(opened.cell)
        outcome = opened.run([watch, drops], injection)
        return _row(opened.cell, injection, watch, outcome, seed, drops)


@contextmanager
def trial(
    path: Path,
    seed: int,
    *,
    rendered: bool = False,
    supervised: Callable[[FaultTable, MotionPlanner], Supervisor] = make_supervisor,
) -> Iterator[Assembly]:
    """A cell with nobody at it, and the tree of trials."""
    cv2.setNumThreads(0)  # a pool of threads does not live on in a forked child, which would wait for it
    configuration = load_configuration(path)
    controller = configuration.controller.model_copy(update={"max_duration_s": LONGEST_S})
    configuration = configuration.model_copy(update={"controller": controller})
    product = load_product(configuration, path)
    configuration, _ = with_detectors_for(configuration, product)
    motion = MotionPlanner(product, configuration.bench, configuration.motion)
    devices = configuration.devices.on_channel(f"trial-{seed}")
    configuration = configuration.model_copy(update={"devices": devices})
    simulation, bus, robot = settings_of(devices.simulation), devices.gripper_bus, configuration.robot
    goal = sorted(product.goals)[0]
    tree = load_tree(TRIAL, node_registry(product))
    files = Files(configuration, product, tree, load_planners(configuration, product), load_faults(configuration))
    cell = SimCell(
        product, configuration.bench, simulation, *bus, seed, goal, worker=False, rendered=rendered, robot=robot
    )

    def run(observers: Sequence[Observer], injected: Injected = None) -> Outcome:
        seen = cell.devices if rendered else without_pixels(cell, configuration, product)
        with attached(configuration, product, seen) as opened:
            return run_controller(files, opened, motion, observers, injection=injected, supervised=supervised)

    try:
        yield Assembly(cell, motion, run)
    finally:
        cell.close()


def _row(
    cell: SimCell, injection: Injection, watch: StoppingDistance, outcome: Outcome, seed: int, drops: Drops
) -> Row:
    kind = FAULTS.get(injection.fault, AS_DATA if injection.fault else None)
    mishap = kind is not None and kind.of_world
    placed = any(placement.seated and placement.by == "robot" for placement in cell.score.placements().values())
    holding = watch.held_before and outcome.end != "finished" and injection.state in HOLDING_STATES
    kept = not drops.dropped if mishap else hangs(cell) if holding else None
    ends = _ends(kind, watch, injection.state)
    reached = injection.began_s is not None
    recoverable = ends == ("finished",)
    recovered = outcome.end == "finished" and placed
    promised = outcome.end in ends and kept is not False and (recovered or not recoverable)
    promised = promised and (placed or not mishap or outcome.end != "finished")
    stood = not mishap and watch.ticks_to_stop >= 0 and not (watch.at_end and outcome.end == "finished")
    return {
        "fault": injection.fault,
        "state": injection.state,
        "seed": seed,
        "reached": reached,
        "end": outcome.end,
        "exit_status": outcome.exit_status,
        "reason": outcome.reason,
        "condition": outcome.condition,
        "ticks_to_stop": watch.ticks_to_stop if stood else -1,
        "ticks_from_fault": watch.ticks_from_fault if stood else -1,
        "stop_s": round(watch.stop_s, 3) if stood else 0.0,
        "stop_m": round(watch.stop_m, 3) if stood else 0.0,
        "held": kept,
        "recoverable": recoverable,
        "recovered": recovered,
        "contact_m_s": 0.0,  # nobody is at the bench
        "as_promised": promised and (reached or kind is None),
    }


def _ends(kind: FaultKind | None, watch: StoppingDistance, state: str) -> tuple[str, ...]:
    """How the run may end."""
    if kind is None or state in kind.unseen_in:
        return ("finished",)
    if kind.holding_ends and watch.held_before:
        return kind.holding_ends
    return (*kind.ends, *kind.holding_ends) if kind.holding_ends and watch.held_lately else kind.ends


def _broken(fault: str, state: str, seed: int, status: int) -> Row:
    """The row of a child that said nothing: it hung, or something ended it."""
    hangs = os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGALRM
    numbers = {"ticks_to_stop": -1, "ticks_from_fault": -1, "stop_s": 0.0, "stop_m": 0.0, "contact_m_s": 0.0}
    words = {"reason": f"status {status} of the child", "condition": "", "end": "hangs" if hangs else "broke off"}
    flags = {"reached": True, "held": None, "recoverable": False, "recovered": False, "as_promised": False}
    return {"fault": fault, "state": state, "seed": seed, "exit_status": -1, **words, **numbers, **flags}


def hangs(cell: SimCell) -> bool:
    """Whether a part hangs above where parts stand, in truth."""
    floor_m = cell.world.bench.tray.centre_m[2]
    pegs = {name: part.peg_length_m for name, part in cell.world.product.parts.items()}
    heights = [cell.world.data.xpos[body.body][2] - floor_m - pegs[body.part] for body in cell.world.bodies]
    return bool(max(heights, default=0.0) > LIFTED_M)
