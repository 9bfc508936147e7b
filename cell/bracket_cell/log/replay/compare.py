"""What two ticks decided, and where they differ: status, nodes, beliefs, plans, verdicts, commands, display."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from bracket_cell.log.read.reader import Log, LoggedTick, Note
from bracket_cell.recording.json_schema import without_nulls
from bracket_cell.recording.schemas import asked_of_devices, judged, plain
from bracket_ground.interfaces.command import Command, Display
from bracket_ground.interfaces.faults import SafetyDecision
from btxml.engine.causes import RELATIONS, Cause
from btxml.engine.node import StatusChange
from btxml.engine.status import Status

NOTHING = "nothing"
MEMORY = "memory"
CAUSE, WHY = "cause", "why"  # notes that explain, and decide nothing
# Other processors round otherwise: the last digits of learned beliefs (32-bit numbers) and of trajectories may differ.
ROUNDING = 1e-6
LEADING = ("command", "judgement", "verdict", "plan")


@dataclass(frozen=True)
class Decisions:
    """Everything that one tick decided, as plain data.

    Attributes:
        judgement: what the supervisor allowed; None where it was not asked.
        error: what the tick raised.
    """

    status: str
    changes: tuple[StatusChange, ...]
    notes: tuple[Note, ...]
    command: Mapping[str, Any] | None
    display: Mapping[str, Any] | None
    judgement: Mapping[str, Any] | None = None
    error: str = ""


@dataclass(frozen=True)
class Difference:
    """One thing that was decided otherwise in one tick.

    Attributes:
        aspect: "node", "status", "command", "display", "judgement", a topic of notes ("belief", "plan", "verdict",
            "help", "skill", "memory"), or for two logs also an input: "time", "arm", "gripper", "bench", "parts",
            "length".
        node: path of the node where `aspect` is "node".
    """

    tick: int
    time_s: float
    aspect: str
    was: Any
    now: Any
    node: str = ""


Compared = tuple[Sequence[StatusChange], Iterable[Cause]]  # of one tick, with the nodes that changed in it
Known = dict[tuple[str, str, str], tuple[int, Cause]]  # by key: in which tick a comparison was noted last


@dataclass(frozen=True)
class Turn:
    """A comparison that answers otherwise in one of two runs, each as it was noted last.

    Attributes:
        noted: ticks of these notes: a comparison is noted only where its answer turns.
    """

    tick: int
    time_s: float
    was: Cause
    now: Cause
    noted: tuple[int, int]

    @property
    def changed(self) -> tuple[str, ...]:
        """What somebody set otherwise that the measured value or the limit depends on."""
        return tuple(name for name in self.was.given if self.was.given[name] != self.now.given.get(name))


@dataclass
class Comparison:
    """Differences of a whole run, kept small: all counts, and the first of every kind.

    Attributes:
        ticks: how many were compared.
        differing_ticks: how many of them differ in anything beyond rounding.
        rounded_ticks: how many differ in rounding alone, as on another processor.
        first: the first difference.
        first_by_aspect, ticks_by_aspect, ticks_by_node: by name.
        at_first: all differences of the first tick that differs.
        command_node: the first node that differs in the tick of the first other command, or before it.
        turns: comparisons that turned out otherwise, up to the first other command.
        first_by_node: the first difference of each node up to there.
        recorded: whether the first run noted any comparison.
    """

    ticks: int = 0
    differing_ticks: int = 0
    rounded_ticks: int = 0
    first: Difference | None = None
    first_by_aspect: dict[str, Difference] = field(default_factory=dict)
    ticks_by_aspect: Counter[str] = field(default_factory=Counter)
    ticks_by_node: Counter[str] = field(default_factory=Counter)
    at_first: list[Difference] = field(default_factory=list)
    command_node: str = ""
    turns: list[Turn] = field(default_factory=list)
    first_by_node: dict[str, Difference] = field(default_factory=dict)
    recorded: bool = False
    _causes: tuple[Known, Known] = field(default_factory=lambda: ({}, {}))
    _idle: tuple[set[str], set[str]] = field(default_factory=lambda: (set(), set()))

    @property
    def leading(self) -> Difference | None:
        """What says most: the first other command, judgement, verdict or plan, else the first difference."""
        return next((self.first_by_aspect[aspect] for aspect in LEADING if aspect in self.first_by_aspect), self.first)

    @property
    def identical(self) -> bool:
        """Bit for bit."""
        return self.agrees and not self.rounded_ticks

    @property
    def agrees(self) -> bool:
        """But for rounding."""
        return self.first is None

    def add(self, found: Sequence[Difference]) -> list[Difference]:
        """The differences of one more tick; returns those beyond rounding, which alone are kept."""
        differences = [diff for diff in found if not close(diff.was, diff.now)]
        self.ticks += 1
        self.rounded_ticks += bool(found) and not differences
        self.differing_ticks += bool(differences)
        self.at_first = self.at_first or list(differences)
        if "command" not in self.first_by_aspect and (node := next((row.node for row in differences if row.node), "")):
            self.command_node = node
        for difference in differences if "command" not in self.first_by_aspect else ():
            self.first_by_node.setdefault(difference.node, difference)
        for difference in differences:
            self.first = self.first or difference
            self.first_by_aspect.setdefault(difference.aspect, difference)
        self.ticks_by_aspect.update({difference.aspect for difference in differences})
        self.ticks_by_node.update(difference.node for difference in differences if difference.node)
        return differences

    def compared(self, number: int, time_s: float, was: Compared, now: Compared) -> None:
        """The comparisons of one more tick, before its differences are added.

        A node that one of the runs does not tick then makes no turn there: something else keeps it from it.
        """
        if "command" in self.first_by_aspect:
            return
        touched = dict[tuple[str, str, str], None]()
        for known, idle, (changes, noted) in zip(self._causes, self._idle, (was, now), strict=True):
            for change in changes:
                (idle.add if change.new is Status.INVALID else idle.discard)(change.path)
            for cause in noted:
                known[cause.key] = number, cause
                touched[cause.key] = None
        before, after = self._causes
        self.recorded |= bool(before)
        for key in touched:
            both = key in before and key in after and before[key][1].holds is not after[key][1].holds
            if both and self._ticked(key[0], was[0], now[0]):
                noted_n = before[key][0], after[key][0]
                self.turns.append(Turn(number, time_s, before[key][1], after[key][1], noted_n))

    def _ticked(self, path: str, *changes: Sequence[StatusChange]) -> bool:
        """Whether both runs may have ticked a node: it runs, or it changed in this tick."""
        pairs = zip(self._idle, changes, strict=True)
        return all(path not in idle or any(change.path == path for change in changed) for idle, changed in pairs)

    def as_json(self) -> dict[str, object]:
        """Keys of the commands' `--json`."""
        return {
            "identical": self.identical,
            "ticks": self.ticks,
            "differing_ticks": self.differing_ticks,
            "rounded_ticks": self.rounded_ticks,
            "first": self.first and vars(self.first),
            "by_decision": {
                aspect: {"ticks": self.ticks_by_aspect[aspect], "first": vars(first)}
                for aspect, first in self.first_by_aspect.items()
            },
            "by_node": dict(self.ticks_by_node.most_common()),
        }


def logged(tick: LoggedTick) -> Decisions:
    """What a tick of a log decided."""
    command = tick.command and {key: value for key, value in tick.command.items() if not key.startswith("sent_")}
    notes = tuple((topic, without_nulls(fields)) for topic, fields in tick.notes if topic not in (CAUSE, WHY))
    display = tick.display and {**plain(Display()), **tick.display}  # older logs lack what it can show since then
    return Decisions(tick.status, tick.changes, notes, without_nulls(command), without_nulls(display), tick.judgement)


def causes_of(tick: LoggedTick) -> Iterator[Cause]:
    """The comparisons that a tick of a log noted."""
    return causes_in(fields for topic, fields in tick.notes if topic == CAUSE)


def causes_in(notes: Iterable[Mapping[str, Any]]) -> Iterator[Cause]:
    """Comparisons from their plain data; what is none is left out."""
    for fields in notes:
        if fields.get("relation") not in RELATIONS:
            continue
        with suppress(KeyError, TypeError, ValueError, AttributeError):
            yield Cause(
                str(fields["by"]),
                str(fields["parameter"]),
                float(fields["measured"]),
                fields["relation"],
                float(fields["limit"]),
                fields["holds"] is True,
                str(fields.get("source", "")),
                str(fields.get("of", "")),
                {str(name): float(value) for name, value in fields["given"].items()},
            )


def decided(
    status: str,
    changes: Iterable[StatusChange],
    notes: Iterable[tuple[str, Any]],
    command: Command,
    judgement: SafetyDecision | None = None,
    error: str = "",
) -> Decisions:
    """What a tick decided that has just been made, in the form in which a log has it."""
    return Decisions(
        status=status,
        changes=tuple(changes),
        notes=tuple((topic, without_nulls(plain(fields))) for topic, fields in notes),
        command=without_nulls(asked_of_devices(command)),
        display=without_nulls(plain(command.display)),
        judgement=None if judgement is None else judged(judgement),
        error=error,
    )


def remembers(log: Log) -> bool:
    """Whether a log has what nodes remember; older ones do not."""
    return any(topic == MEMORY for tick in log.ticks for topic, _ in tick.notes)


def differences(number: int, time_s: float, was: Decisions, now: Decisions, memory: bool = True) -> list[Difference]:
    """Where two ticks decided otherwise, nodes first, in the order in which they were ticked.

    Args:
        memory: both tell what nodes remember.
    """
    found = [
        Difference(number, time_s, "node", before, after, node)
        for node, before, after in _changed_nodes(was.changes, now.changes)
    ]
    topics = dict.fromkeys(topic for topic, _ in (*was.notes, *now.notes) if memory or topic != MEMORY)
    pairs: list[tuple[str, Any, Any]] = [(topic, _about(was, topic), _about(now, topic)) for topic in topics]
    pairs = [(topic, a, _as_then(a, b) if topic == MEMORY else b) for topic, a, b in pairs]
    status = f"{now.status}: {now.error}" if now.error else now.status
    # Where the recorded tick raised, a device may have: nodes, notes and command tell whether this one is the same.
    pairs.append(("status", was.status, was.status if was.status == "ERROR" else status))
    pairs += [("command", was.command, now.command), ("display", was.display, now.display)]
    if was.judgement is not None:  # logs from before the supervisor have none
        pairs.append(("judgement", was.judgement, now.judgement))
    found += [Difference(number, time_s, aspect, *_narrowed(a, b)) for aspect, a, b in pairs if a != b]
    return found


def _as_then(was: Any, now: Any) -> Any:
    """What is remembered now, without what is empty and had no name in the log's release, at any depth."""
    if isinstance(was, dict) and isinstance(now, dict):
        known = {key: value for key, value in now.items() if key in was or value not in ({}, [], "")}
        return {key: _as_then(was.get(key), value) for key, value in known.items()}
    if isinstance(was, list) and isinstance(now, list) and len(was) == len(now):
        return [_as_then(before, after) for before, after in zip(was, now, strict=True)]
    return now


def input_differences(one: LoggedTick, other: LoggedTick) -> list[Difference]:
    """Where two logged ticks saw different things."""
    a, b = one.observation, other.observation
    pairs = [("time", a.time_s, b.time_s)]
    pairs += [(name, getattr(a, name), getattr(b, name)) for name in ("bench", "parts", "arm", "gripper")]
    return [Difference(one.number, one.time_s, name, *_narrowed(plain(x), plain(y))) for name, x, y in pairs if x != y]


def _changed_nodes(was: Sequence[StatusChange], now: Sequence[StatusChange]) -> Iterator[tuple[str, Any, Any]]:
    if was == now:
        return
    before, after = _by_node(was), _by_node(now)
    if before == after:
        yield "", "the same changes in another order", [change.path for change in now]
    for node in dict.fromkeys((*before, *after)):
        if before.get(node) != after.get(node):
            yield node, before.get(node, NOTHING), after.get(node, NOTHING)


def _by_node(changes: Sequence[StatusChange]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for change in changes:
        feedback = f" ({change.feedback})" if change.feedback else ""
        found.setdefault(change.path, []).append(f"{change.old.name} -> {change.new.name}{feedback}")
    return found


def _about(decisions: Decisions, topic: str) -> list[dict[str, Any]]:
    return [fields for name, fields in decisions.notes if name == topic]


def _narrowed(was: Any, now: Any) -> tuple[Any, Any]:
    """Of two mappings only what differs."""
    if isinstance(was, Mapping) and isinstance(now, Mapping):
        keys = [key for key in dict.fromkeys((*was, *now)) if was.get(key) != now.get(key)]
        return {key: was.get(key) for key in keys}, {key: now.get(key) for key in keys}
    return was, now


def close(was: Any, now: Any) -> bool:
    """Whether two values are the same but for rounding."""
    if isinstance(was, Mapping) and isinstance(now, Mapping):
        return was.keys() == now.keys() and all(close(was[key], now[key]) for key in was)
    if isinstance(was, list | tuple) and isinstance(now, list | tuple):
        return len(was) == len(now) and all(map(close, was, now))
    if isinstance(was, float) and isinstance(now, float | int) and not isinstance(now, bool):
        return math.isclose(was, now, rel_tol=ROUNDING, abs_tol=ROUNDING)
    return bool(was == now)
