"""Rules of a cell: a file beside a tree (`mine.rules.yaml`), and what of a tick its expressions can name."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, NamedTuple

from pydantic import Field, model_validator

from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_ground.errors import InputError, Place, Problem
from bracket_ground.files.model import Disagreement, Model
from bracket_ground.files.words.message import Message
from bracket_ground.files.yaml_file import load_yaml, place_of
from bracket_ground.interfaces.command import Command
from bracket_ground.interfaces.observation import LOGGED_AS, ArmState, GripperState, Observation
from bracket_ground.interfaces.operator import OperatorState
from btxml.engine.blackboard import UNSET, Scope
from btxml.engine.status import Status
from btxml.engine.tree import Tree
from btxml.files.parse.library import hint
from btxml.rules import Expression, Moment, Nodes, RuleError, Truth, Violation, Watched, nodes_of

SUFFIX, RULES = ".rules.yaml", "rules.yaml"  # beside a tree; in a log
OPENS_M = 0.001  # a goal that is farther from the measured opening opens or closes the fingers
AXES = ("x_m", "y_m", "z_m")
COMMANDED = ("moves", "stops", "opens", "closes", "opening_m")
OF_DEVICES: Mapping[str, type[Any]] = {"arm": ArmState, "gripper": GripperState, "operator": OperatorState}


class Rule(Model):
    """What must never, or always, hold.

    Attributes:
        name: for messages.
        never: an expression that must hold in no tick.
        always: an expression that must hold in every tick.
        action: what the cell does where the rule is broken: warn, hold (until a person acknowledges it) or stop.
        unknown_after_s: a rule of hold or stop that is unknown for longer holds the cell [s].
    """

    name: str = Field(min_length=1, max_length=200)
    never: str | None = None
    always: str | None = None
    action: Literal["warn", "hold", "stop"] = "warn"
    unknown_after_s: float = Field(
        default=5.0, ge=0.0
    )  # a person who reaches in needs less: what is unknown is soon told

    @model_validator(mode="after")
    def _can_be_read(self) -> Rule:
        if (self.never is None) == (self.always is None):
            raise ValueError("give either never or always")
        try:
            Expression(self.text)
        except RuleError as error:
            legal = f"; legal: {error.legal}" if error.legal else ""
            raise Disagreement([((self.key,), f"column {error.column} of the rule: {error}{legal}")]) from None
        return self

    @property
    def key(self) -> str:
        return "always" if self.never is None else "never"

    @property
    def text(self) -> str:
        return self.never or self.always or ""


class Rules(Model):
    """The rules of a tree.

    Attributes:
        rules: each has a name of its own.
    """

    rules: tuple[Rule, ...] = ()

    @model_validator(mode="after")
    def _names_differ(self) -> Rules:
        names = [rule.name for rule in self.rules]
        twice = [place for place, name in enumerate(names) if name in names[:place]]
        if twice:
            raise Disagreement([(("rules", place, "name"), f"{names[place]!r} is there already") for place in twice])
        return self


def rules_beside(tree: Path) -> Path | None:
    """The file with the rules of a tree file; None where there is none."""
    path = tree.with_suffix(SUFFIX)
    return path if path.is_file() else None


def load_rules(path: Path) -> Rules:
    """Read a file of rules.

    Raises:
        InputError: with every problem of the file.
    """
    return load_yaml(path, Rules)


class CheckedRules(NamedTuple):
    """What there is to say about a file of rules for a tree.

    Attributes:
        doubts: rules that can never be broken, or never be kept.
        notes: rules that are unknown at first.
    """

    problems: list[Problem]
    doubts: list[Problem]
    notes: list[Problem]


def check_rules(path: Path, tree: Tree) -> CheckedRules:
    """What is wrong with a file of rules for a tree.

    Raises:
        InputError: the file cannot be read.
    """
    found = CheckedRules([], [], [])
    nodes = nodes_of(tree)
    for number, rule in enumerate(load_rules(path).rules):
        expression, place = Expression(rule.text), place_of(path, ("rules", number, rule.key))
        unknown = list(_unknown(expression, nodes, tree.blackboard, place))
        found.problems.extend(unknown)
        if expression.is_constant:
            kept = expression(Situation(0.0)) is (rule.key == "always")
            what = f"this rule can never be {'broken' if kept else 'kept'}: it names nothing"
            found.doubts.append(Problem(place, what))
        own = [name for name in expression.names if name in tree.blackboard]
        empty = [name for name in own if tree.blackboard.entry(name).value is UNSET]
        if empty and not unknown:
            holds = f", and holds the cell after {rule.unknown_after_s:g} s of that" if rule.action != "warn" else ""
            what = f"rule '{rule.name}' is unknown, and not kept, until {', '.join(empty)} is written{holds}"
            found.notes.append(Problem(place, what))
    return found


def _unknown(expression: Expression, nodes: Nodes, blackboard: Scope, place: Place) -> Iterator[Problem]:
    for label in expression.nodes:
        if label not in nodes:
            yield Problem(place, f"the tree has no node '{label}'", hint(label, list(nodes)))
    for name in expression.names:
        legal = list(_states(name.partition(".")[0])) if "." in name else list(blackboard)
        if name not in legal:
            what = f"there is no state '{name}'" if "." in name else f"the tree has no entry '{name}'"
            yield Problem(place, what, hint(name, legal or [state for part in _STATES for state in _states(part)]))


def _states(part: str) -> Iterator[str]:
    """States whose name begins with a part and a dot."""
    if part in OF_DEVICES:
        kind = OF_DEVICES[part]
        own = [name for name, var in vars(kind).items() if isinstance(var, property)]
        yield from (f"{part}.{name}" for name in (*(field.name for field in fields(kind)), *own))
    yield from (f"{part}.{name}" for name in {"tool": AXES, "command": COMMANDED}.get(part, ()))
    if part == "cell":
        yield from (f"cell.{name}" for name in _CELL)


_CELL = {LOGGED_AS.get(name, name): name for name in ("time_s", "late_s", "acknowledged", "speed_scale", "work_s")}
_STATES = (*OF_DEVICES, "tool", "command", "cell")


@dataclass
class Situation:
    """What a rule can name in one tick; what is not given is unknown.

    Attributes:
        command: what was asked of the devices, as an object or as a log has it.
        kinematics: to tell where the tool is.
    """

    time_s: float
    observation: Observation | None = None
    command: Command | Mapping[str, Any] | None = None
    entries: Mapping[str, Any] = field(default_factory=dict)
    nodes: Nodes | None = None
    kinematics: Kinematics | None = None

    def is_so(self, node: str, status: Status) -> Truth:
        return None if self.nodes is None else self.nodes.is_so(node, status)

    def value(self, name: str) -> Any:
        part, _, rest = name.partition(".")
        if not rest:
            value = self.entries.get(name)
            return None if value is UNSET else value
        if self.observation is None or name not in _states(part):
            return self.observation.signals.get(rest) if self.observation and part == "signals" else None
        if part == "tool":
            return self._tool(self.observation, AXES.index(rest))
        if part == "command":
            return self._commanded(self.observation, rest)
        if part == "cell":
            return getattr(self.observation, _CELL[rest])
        return getattr(getattr(self.observation, part), rest)

    def _tool(self, seen: Observation, axis: int) -> float | None:
        joints = None if self.kinematics is None else seen.arm.known_rad(self.kinematics.count)
        if joints is None or self.kinematics is None:
            return None
        import numpy as np

        return float(self.kinematics.position_m(np.array(joints))[axis])

    def _commanded(self, seen: Observation, what: str) -> Any:
        asked = self.command or Command()
        command = asked if isinstance(asked, Mapping) else vars(asked)
        gripper = command.get("gripper")
        goal_m = gripper.get("opening_m") if isinstance(gripper, Mapping) else getattr(gripper, "opening_m", None)
        if what == "opening_m":
            return goal_m
        by_m = 0.0 if goal_m is None else goal_m - seen.gripper.opening_m
        return {
            "moves": command.get("follow") is not None,
            "stops": bool(command.get("stop_arm")),
            "opens": by_m > OPENS_M,
            "closes": by_m < -OPENS_M,
        }[what]


class RuleWatch:
    """Watches all rules of a file over the ticks of a run.

    Attributes:
        watched: the rules, in order.
    """

    def __init__(self, rules: Sequence[Rule]) -> None:
        self.rules = tuple(rules)
        self.watched = [Watched(rule.name, Expression(rule.text), rule.never is None) for rule in rules]

    def step(self, tick: int, moment: Moment) -> list[Violation]:
        """Take a tick; the violations that begin in it."""
        return [found for watched in self.watched if (found := watched.step(tick, moment)) is not None]

    @property
    def names_entries(self) -> bool:
        """Whether a rule names an entry of the blackboard."""
        return any("." not in name for watched in self.watched for name in watched.expression.names)

    @property
    def ticks(self) -> dict[str, tuple[int, int, int]]:
        """By rule, in how many ticks so far it was kept, broken and unknown."""
        return {watched.name: watched.ticks for watched in self.watched}

    def acting(self, situation: Situation) -> Iterator[tuple[str, Message]]:
        """What the cell must do now, and why: for what is broken, and for what matters and is unknown for too long."""
        for rule, watched in zip(self.rules, self.watched, strict=True):
            why, unknown_s = watched.reason(situation), watched.unknown_s(situation.time_s)
            if watched.broken:
                yield rule.action, Message("rule '{name}' is broken: {why}", name=rule.name, why=why)
            elif rule.action != "warn" and watched.unknown_since_s is not None and unknown_s >= rule.unknown_after_s:
                text = "rule '{name}' is unknown for {s:g} s or more: {why}"
                yield "hold", Message(text, name=rule.name, s=rule.unknown_after_s, why=why)


def watch_of(paths: Iterable[Path]) -> RuleWatch:
    """The rules of several files.

    Raises:
        InputError: a file cannot be read, or two rules have the same name.
    """
    rules = [rule for path in paths for rule in load_rules(path).rules]
    names = [rule.name for rule in rules]
    if twice := {name for name in names if names.count(name) > 1}:
        raise InputError(f"two rules are named {', '.join(sorted(twice))}; each has a name of its own")
    return RuleWatch(rules)
