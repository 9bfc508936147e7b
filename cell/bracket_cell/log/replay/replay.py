"""Ticks the tree of a log on what the log says that it saw, and compares what it decides; no devices, no simulator."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any
from weakref import finalize

from bracket_cell.log.read.reader import Log, LoggedTick, json_of
from bracket_cell.log.read.ticks import Gap, holding
from bracket_cell.log.replay.compare import (
    Comparison,
    Decisions,
    Difference,
    causes_of,
    decided,
    differences,
    logged,
    remembers,
)
from bracket_cell.log.replay.loading import Changes, load, recorded_tree
from bracket_cell.log.replay.logged_tree import code_differs, logged_rules, logged_tree, unpacked
from bracket_cell.log.replay.matching import caused_by, partners, renamed
from bracket_cell.log.replay.perceive import perceived
from bracket_cell.recording.identity import UNKNOWN, versions, what_changed
from bracket_cell.running.controller import STOPPED, STOPPING
from bracket_cell.running.device_writer import withhold
from bracket_cell.running.safe_stop import failure
from bracket_cell.running.supervisor import make_supervisor
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.trees.node_library import node_registry
from bracket_cell.trees.nodes.files import LoggedFiles
from bracket_cell.trees.rules import load_rules, rules_beside
from bracket_cell.wiring.reload import set_up, take_over
from bracket_cell.wiring.ruled import RuleLook
from bracket_cell.wiring.run_state import go_on_from
from bracket_cell.wiring.safety import SAFETY, other_limits
from bracket_cell.wiring.services import TickClock, make_services
from bracket_cell.wiring.state_reader import StateError
from bracket_ground.errors import InputError, LogError, mistakes
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.faults import Action, SafetyDecision
from bracket_ground.interfaces.notes import ListJournal
from bracket_ground.interfaces.resume import ResumeState
from btxml.engine.causes import Causes, collecting
from btxml.engine.hooks import ORDERS, Hooks
from btxml.engine.node import StatusChange
from btxml.engine.outside import LoggedAnswers

ENDS = ("SUCCESS", "FAILURE", "ERROR")
MID_TICK = "interrupted in mid-tick"


@dataclass(frozen=True)
class Step:
    """One tick, as it was and as it is when replayed.

    Attributes:
        blackboard: of the main tree after the replayed tick.
        differences: empty where both are the same.
    """

    logged: LoggedTick
    now: Decisions
    blackboard: Mapping[str, Any]
    differences: list[Difference]


class Replay:
    """The tree of a log, or a changed one, ready to be ticked again.

    Edits that took over during the run and what a monitor did to nodes are done again in the ticks in which they were.

    Attributes:
        remarks: what of the log was not replayed, and why, for people; whole after `run`.
        first: number of the tick that it begins with.
        names: paths of the recorded nodes by those of the nodes that stand for them, where the tree is another one.
        log: what it sees; `recorded` is that of the run, which other detectors may see otherwise.

    Raises:
        LogError: the log lacks what a replay needs, or was recorded with other weights than these.
        InputError, ModelError: a changed file cannot be used.
    """

    def __init__(self, log: Log, changes: Changes | None = None, bracket: int | None = None) -> None:
        """Args:
        bracket: of a shift, to begin with; by default tick 0, or the first bracket whose beginning the log still holds.
        """
        if not log.ticks:
            raise LogError(log.path, "holds no tick that could be replayed")
        self.log = self.recorded = log
        self.changes = changes or Changes()
        self.remarks: list[str] = []
        self._other, self._memory = self.changes.tree is not None, remembers(log)
        self.remarks += [f"recorded with other versions: {line}" for line in what_changed(log.metadata)]
        self.remarks += [f"of another release; in a clone its own replays it: {way}" for way in its_program(log)]
        self.remarks += _other_limits(log)
        self._files = ExitStack()
        finalize(self, self._files.close)
        self._begin(_start(log, bracket))

    def _begin(self, place: int) -> None:
        """Make everything ready for the tick at a place of the log; beyond the first with the state before it."""
        log, before = self.log, self.log.ticks[max(0, place - 1)]
        edits = [fields["files"] for tick in log.ticks[:place] for kind, fields in tick.inputs if kind == "edit"]
        edited = edits[-1] if edits else {}
        configuration, product, planners, self.tree, faults = load(log, self.changes, edited, self._files)
        self._configured = configuration.nodes
        self.names = self._named()
        self.remarks += [f"recorded with other code: {line}" for line in code_differs(log, self.tree)]
        if self.changes.perception is not None and log is self.recorded:
            self.log, remark = perceived(log, configuration, product, self.changes.perception)
            self.remarks += [remark] if remark else []
            log, before = self.log, self.log.ticks[max(0, place - 1)]
        motion = MotionPlanner(product, configuration.bench, configuration.motion)
        self._supervisor = make_supervisor(faults, motion)
        own = None if self.changes.tree is None else rules_beside(self.changes.tree)
        rules = logged_rules(log) if own is None else load_rules(own)
        self._rules = RuleLook(rules.rules, motion.kinematics)
        self._halted = False
        self._journal, self._causes = ListJournal(), Causes()
        left_off = None if place else json_of(log.path, log.metadata, "left_off", ResumeState.of)
        self._services = make_services(
            configuration,
            planners,
            motion,
            self._journal,
            before.observation,
            left_off or ResumeState(),
            LoggedFiles(_notes(log.ticks[place:], "file")),
            LoggedAnswers(_notes(log.ticks[place:], "outside")),
        )
        self._clock = TickClock(self._services)
        set_up(self.tree, self._services, self._clock)
        self._hooks = Hooks(self.tree, _nobody)
        self.first = log.ticks[place].number
        self._place = place
        if place:
            self._go_on(before)

    def _named(self) -> dict[str, str]:
        if not self._other:
            return {}
        try:
            return partners(logged_tree(self.recorded, self.changes.nodes), self.tree)
        except (LogError, InputError) as error:
            self.remarks.append(f"nodes are compared by their paths, as the log's tree cannot be read: {error}")
            return {}

    def _go_on(self, before: LoggedTick) -> None:
        """Take the state that the log holds after a tick."""
        state, where = (
            before.state or {},
            f"cannot be replayed from tick {before.number + 1} at {before.time_s:.2f} s on",
        )
        if "lost" in state:
            raise LogError(self.log.path, f"{where}: {state['lost']}")
        try:
            anew = go_on_from(state, self.tree, self._services, self._supervisor)
        except StateError as error:
            raise LogError(self.log.path, f"{where}: {error}") from None
        self._journal.take()
        self.remarks.append(f"begins after tick {before.number} at {before.time_s:.2f} s, with the state that was kept")
        if anew and self._other:
            self.remarks.append(f"begin anew: {', '.join(anew)}")
        elif anew:
            raise LogError(self.log.path, f"holds the state of another tree; it lacks {', '.join(anew)}")

    def run(
        self, from_s: float = 0.0, until_s: float = float("inf"), watch: Callable[[Step], bool | None] = lambda _: None
    ) -> Comparison:
        """Tick all logged ticks up to a time, comparing from another time on; once for each Replay.

        Args:
            watch: sees every compared tick; ends the replay by answering False.
        """
        comparison, ticks, place = Comparison(), self.log.ticks, self._place
        while place < len(ticks) and ticks[place].time_s <= until_s:
            tick = ticks[place]
            if place > self._place and tick.number != ticks[place - 1].number + 1:
                gap = Gap(ticks[place - 1].number + 1, tick.number - 1)
                place = _next_start(ticks, place)
                there = place < len(ticks)
                ends = f"goes on with tick {ticks[place].number}" if there else "ends before"
                self.remarks.append(f"{gap}: the replay {ends}, as nodes remember what they saw")
                if there:
                    self._begin(place)
                continue
            if tick.status == "ERROR" and self.log.outcome.get("reason") == MID_TICK:
                break  # a second signal stopped it anywhere
            with collecting(self._causes):
                now = self._tick(tick)
            now = replace(now, changes=renamed(now.changes, self.names))
            caused = caused_by(self._causes.take(), self.names)
            comparison.compared(tick.number, tick.time_s, (tick.changes, causes_of(tick)), (now.changes, caused))
            if tick.time_s >= from_s:
                found = comparison.add(differences(tick.number, tick.time_s, logged(tick), now, self._memory))
                if watch(Step(tick, now, self.tree.blackboard.values(), found)) is False:
                    break
                if self.changes.perception is not None and any(difference.aspect == "command" for difference in found):
                    break  # the bench would have gone another way from here on
            if (now.status in ENDS or tick.status in ENDS) and not self._stops_next(place):
                break
            place += 1
        return comparison

    def _stops_next(self, place: int) -> bool:
        """Whether the next tick of the log is one of the safe stop."""
        following = self.log.ticks[place + 1 : place + 2]
        return bool(following) and following[0].status == STOPPING

    def _tick(self, tick: LoggedTick) -> Decisions:
        self._services.now.observation, self._services.now.command = tick.observation, Command()
        judgement = self._judged(tick)
        if tick.status == STOPPED:
            return decided(STOPPED, (), (), Command(), judgement)
        if tick.status == STOPPING:
            return self._stopping_tick(judgement)
        for kind, fields in tick.inputs:
            self._take(kind, fields, tick)
        error = ""
        command = self._services.now.command
        try:
            status = self.tree.tick().name
            self._rules.look(self.tree, self._services.now)
            asked = replace(command)
            judgement = self._supervisor.judge_command(tick.observation, command)
            if judgement.action >= Action.HOLD and tick.judgement is not None:  # older logs were not judged
                withhold(command, tick.observation, judgement)
        except (Exception, SystemExit) as problem:  # as in the controller's loop: what is raised is compared
            status, error, asked = "ERROR", f"{type(problem).__name__}: {problem}", command
        return decided(status, self.tree.status_changes, self._journal.take(), asked, judgement, error)

    def _judged(self, tick: LoggedTick) -> SafetyDecision:
        try:
            return self._supervisor.judge(tick.observation, tick.status == STOPPING)
        except Exception as error:  # what a log says that is wrong may raise anything in checks of sound values
            what = f"tick {tick.number} at {tick.time_s:.2f} s cannot be judged: {mistakes(error)[0]}"
            raise LogError(self.log.path, what) from None

    def _stopping_tick(self, judgement: SafetyDecision) -> Decisions:
        """A tick of the safe stop: the supervisor goes on judging, and the tree is halted once."""
        changes: Sequence[StatusChange] = ()
        if not self._halted:
            self._halted = True
            failure(self.tree.halt)  # as in the safe stop: what nodes raise there ends nothing
            changes = self.tree.status_changes
        stopped = SafetyDecision(Action.STOP, 0.0, judgement.reasons)
        return decided(STOPPING, changes, self._journal.take(), Command(), stopped)

    def _take(self, kind: str, fields: Mapping[str, Any], tick: LoggedTick) -> None:
        """Do again what came from outside, where nodes are those of the log."""
        if self._other:
            what = "an edit" if kind == "edit" else "an order of a monitor"
            self.remarks.append(f"{what} at {tick.time_s:.2f} s is left out, as another tree is replayed")
        elif kind == "edit":
            self._exchange(fields["files"])
        else:
            with holding(self.log.path, "an order of a monitor"):
                ORDERS[fields["order"]](self._hooks, fields["body"])

    def _exchange(self, texts: Mapping[str, str]) -> None:
        """Let an edited tree take over as it did in the run."""
        own = node_registry(more=(*self.changes.nodes, *self._configured))
        with unpacked(self.log, {name: text.encode() for name, text in texts.items()}) as folder:
            following = recorded_tree(self.log, folder, own)
        take_over(self.tree, following, self._services, self._clock)
        self.tree, self._hooks = following, Hooks(following, _nobody)


def _start(log: Log, bracket: int | None) -> int:
    """Place of the first tick to be replayed: 0, or one after which the log holds the state of the run.

    Raises:
        LogError: there is no such tick.
    """
    begun = {
        fields["number"]: place + 1
        for place, tick in enumerate(log.ticks)
        for topic, fields in tick.notes
        if topic == "bracket" and fields.get("edge") == "begin" and tick.state is not None
    }
    first = log.ticks[0].number
    if bracket is not None:
        found = begun.get(bracket, 0 if not first and bracket == 1 else None)
        if found is None:
            held = ", ".join(map(str, begun)) or "none"
            raise LogError(log.path, f"holds no beginning of bracket {bracket}; held: {held}")
        return found
    place = _next_start(log.ticks, 0) if first else 0
    if place == len(log.ticks):
        what = f"begins with tick {first}; nodes remember what they saw, so a replay needs tick 0"
        raise LogError(log.path, f"{what}, or the beginning of a bracket: name the first part")
    return place


def _next_start(ticks: Sequence[LoggedTick], place: int) -> int:
    """Of ticks from a place on the first after which the log holds a state; their number where there is none."""
    return next((i + 1 for i in range(place, len(ticks)) if ticks[i].state is not None), len(ticks))


def _notes(ticks: Sequence[LoggedTick], about: str) -> list[dict[str, Any]]:
    return [fields for tick in ticks for topic, fields in tick.notes if topic == about]


def _nobody(_: int) -> None:
    """Nobody waits for news of breakpoints."""


def its_program(log: Log) -> list[str]:
    """The command that runs the release that recorded a log; none where it is this one, or it names no commit."""
    release, commit = (log.metadata.get(name) for name in ("version.cell", "commit"))
    if release == versions()["version.cell"] or commit in (None, UNKNOWN):
        return []
    runs = f"make -C ../recorder doctor && ../recorder/.venv/bin/cell replay {log.path}"
    return [f"git worktree add ../recorder {commit} && {runs}"]


def _other_limits(log: Log) -> list[str]:
    """Numbers in code that guard people and are others than in the run, a line each; older logs do not tell them."""
    if (recorded := log.attachments.get(SAFETY)) is None:
        return []
    try:
        return [f"recorded with other limits: {line}" for line in other_limits(recorded.decode())]
    except (ValueError, RecursionError) as error:
        raise LogError(log.path, f"has a {SAFETY} that cannot be read: {error}") from None
