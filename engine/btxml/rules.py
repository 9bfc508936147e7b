"""Rules: what must never, or always, hold while a tree runs; past-time metric temporal logic over its ticks.

An expression is written in Python's grammar, and interpreted, never run. It is evaluated once a tick, by the
recurrences of Havelund and Rosu, "Synthesizing monitors for safety properties" (TACAS 2002), with bounds in seconds:

    once(s, A)      A held at some time in the last s seconds
    held(s, A)      A has held for s seconds without a break
    since(A, B)     B held at some time, and A ever after
    began(A)        A holds, and did not in the tick before
    implies(A, B)   B holds wherever A does
    running("N"), succeeded("N"), failed("N")    of a node by its path, its name or its tag: it runs, or ended so now

What has no value yet is unknown, and so is all that depends on it (Kleene's three values): a rule that is unknown is
neither kept nor broken, and one that was broken stays so until it is kept again.
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from numbers import Real
from typing import Any, Protocol

from btxml.engine.literals import shown
from btxml.engine.node import StatusChange
from btxml.engine.status import FAILURE, RUNNING, SUCCESS, Status
from btxml.engine.tree import Tree

Truth = bool | None
LENGTH_LIMIT, DEPTH_LIMIT = 2000, 30  # characters, and levels: more than anybody reads
STATUSES: Mapping[str, Status] = {"running": RUNNING, "succeeded": SUCCESS, "failed": FAILURE}
ARGUMENTS = {"once": 2, "held": 2, "since": 2, "began": 1, "implies": 2, **dict.fromkeys(STATUSES, 1)}
_COMPARE: Mapping[type[ast.cmpop], Callable[[Any, Any], Any]] = {
    **{ast.Eq: operator.eq, ast.NotEq: operator.ne, ast.Lt: operator.lt, ast.LtE: operator.le},
    **{ast.Gt: operator.gt, ast.GtE: operator.ge},
}
_CALCULATE: Mapping[type[ast.operator], Callable[[Any, Any], Any]] = {
    **{ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv}
}


class RuleError(ValueError):
    """An expression that is none; `column` counts from 1."""

    def __init__(self, what: str, column: int = 1, legal: str = "") -> None:
        super().__init__(what)
        self.column, self.legal = column, legal


class Moment(Protocol):
    """What a rule is asked about: one tick."""

    time_s: float

    def value(self, name: str) -> Any:
        """Of an entry or a state such as `gripper.opening_m`; None where it is unknown."""
        ...

    def is_so(self, node: str, status: Status) -> Truth:
        """Whether a node runs, or ended so in this tick; None where there is no such node."""
        ...


@dataclass
class Past:
    """What a temporal operator remembers.

    Attributes:
        now: its last answer, or that of its operand.
        true_s, false_s, unknown_s: when its operand was so last.
        since_s: since when its operand holds without a break; None while it does not.
    """

    now: Truth = False
    true_s: float = -math.inf
    false_s: float = -math.inf
    unknown_s: float = -math.inf
    since_s: float | None = None

    def see(self, time_s: float, operand: Truth) -> None:
        if operand is None:
            self.unknown_s, self.since_s = time_s, None
        elif operand:
            self.true_s = time_s
            self.since_s = time_s if self.since_s is None else self.since_s
        else:
            self.false_s, self.since_s = time_s, None


Formula = Callable[[Moment], Any]


class Expression:
    """A checked expression and its past.

    Attributes:
        names: entries and states that it names, with their columns.
        nodes: nodes that it names, with their columns.
        past: of its temporal operators, in the order of the text; what must be kept to go on elsewhere.

    Raises:
        RuleError: it is none.
    """

    def __init__(self, text: str) -> None:
        if len(text) > LENGTH_LIMIT:
            raise RuleError(f"{len(text)} characters are too many", legal=f"at most {LENGTH_LIMIT}")
        self.names: dict[str, int] = {}
        self.nodes: dict[str, int] = {}
        self.past: list[Past] = []
        self._depth = 0
        try:
            parsed = ast.parse(text.strip(), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
            raise RuleError(
                f"cannot be read: {getattr(error, 'msg', error)}", getattr(error, "offset", 1) or 1
            ) from None
        self._formula = self._of(parsed)

    def __call__(self, moment: Moment) -> Truth:
        """Whether it holds in this tick; to be asked once a tick, in order."""
        return _truth(self._formula(moment))

    @property
    def is_constant(self) -> bool:
        """Whether it says the same in every tick, as it names nothing."""
        return not self.names and not self.nodes

    def _of(self, node: ast.expr) -> Formula:
        self._depth += 1
        if self._depth > DEPTH_LIMIT:
            raise RuleError(f"nests deeper than {DEPTH_LIMIT}", node.col_offset + 1)
        found = self._made(node)
        self._depth -= 1
        return found

    def _made(self, node: ast.expr) -> Formula:
        if isinstance(node, ast.Constant) and isinstance(node.value, bool | int | float | str):
            return lambda _, value=node.value: value  # type: ignore[misc]
        if isinstance(node, ast.Name | ast.Attribute):
            return self._name(node)
        if isinstance(node, ast.BoolOp):
            parts = [self._of(part) for part in node.values]
            both = isinstance(node.op, ast.And)
            return lambda moment: _joined([_truth(part(moment)) for part in parts], both)  # all: each has its past
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
            inner, negated = self._of(node.operand), isinstance(node.op, ast.Not)
            return lambda moment: (
                _not(_truth(inner(moment))) if negated else _calculated(operator.sub, 0, inner(moment))
            )
        if isinstance(node, ast.BinOp) and type(node.op) in _CALCULATE:
            left, right, calculate = self._of(node.left), self._of(node.right), _CALCULATE[type(node.op)]
            return lambda moment: _calculated(calculate, left(moment), right(moment))
        if isinstance(node, ast.Compare) and all(type(cmpop) in _COMPARE for cmpop in node.ops):
            return self._comparison(node)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and not node.keywords:
            return self._call(node, node.func.id)
        legal = "names, numbers, texts, and, or, not, comparisons, + - * /, " + ", ".join(ARGUMENTS)
        raise RuleError("this means nothing in a rule", node.col_offset + 1, legal)

    def _name(self, node: ast.Name | ast.Attribute) -> Formula:
        name = ast.unparse(node)
        if not all(part.isidentifier() for part in name.split(".")):
            raise RuleError(f"'{name}' is not a name", node.col_offset + 1, "like part or gripper.opening_m")
        self.names.setdefault(name, node.col_offset + 1)
        return lambda moment: moment.value(name)

    def _comparison(self, node: ast.Compare) -> Formula:
        terms = [self._of(part) for part in (node.left, *node.comparators)]
        signs = [_COMPARE[type(cmpop)] for cmpop in node.ops]

        def compare(moment: Moment) -> Truth:
            values = [term(moment) for term in terms]
            links = zip(signs, values, values[1:], strict=False)
            return _joined([_compared(sign, left, right) for sign, left, right in links], True)

        return compare

    def _call(self, node: ast.Call, name: str) -> Formula:
        column = node.col_offset + 1
        if len(node.args) != ARGUMENTS.get(name, -1):
            what = f"there is no '{name}'" if name not in ARGUMENTS else f"{name} takes {ARGUMENTS[name]} arguments"
            raise RuleError(what, column, ", ".join(ARGUMENTS))
        if name in STATUSES:
            return self._status(node.args[0], STATUSES[name])
        if name in ("once", "held"):
            return self._bounded(name, _seconds(node.args[0]), self._of(node.args[1]))
        parts = [self._of(part) for part in node.args]
        if name == "implies":
            return lambda moment: _joined([_not(_truth(parts[0](moment))), _truth(parts[1](moment))], False)
        past = Past()
        self.past.append(past)
        return _since(past, *parts) if name == "since" else _began(past, *parts)

    def _status(self, node: ast.expr, status: Status) -> Formula:
        if not (isinstance(node, ast.Constant) and isinstance(node.value, str)):
            raise RuleError("a node is named by a text", node.col_offset + 1, 'like running("PickPart")')
        label: str = node.value
        self.nodes.setdefault(label, node.col_offset + 1)
        return lambda moment: moment.is_so(label, status)

    def _bounded(self, name: str, limit_s: float, inner: Formula) -> Formula:
        past = Past()
        self.past.append(past)

        def once(moment: Moment) -> Truth:
            past.see(moment.time_s, _truth(inner(moment)))
            if moment.time_s - past.true_s <= limit_s:
                return True
            return None if moment.time_s - past.unknown_s <= limit_s else False

        def held(moment: Moment) -> Truth:
            operand = _truth(inner(moment))
            past.see(moment.time_s, operand)
            if past.since_s is None:
                return operand and None
            return moment.time_s - past.since_s >= limit_s

        return once if name == "once" else held


def _since(past: Past, holds: Formula, event: Formula) -> Formula:
    def since(moment: Moment) -> Truth:
        both = _joined([_truth(holds(moment)), past.now], True)
        past.now = _joined([_truth(event(moment)), both], False)
        return past.now

    return since


def _began(past: Past, inner: Formula) -> Formula:
    def began(moment: Moment) -> Truth:
        before, past.now = past.now, _truth(inner(moment))
        return _joined([past.now, _not(before)], True)

    return began


def _seconds(node: ast.expr) -> float:
    value = node.value if isinstance(node, ast.Constant) else None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value < math.inf:
        raise RuleError("a time is a number of seconds", node.col_offset + 1, "like once(5, ...)")
    return float(value)


def _truth(value: Any) -> Truth:
    """Unknown where a value is neither true nor false, such as an array."""
    try:
        return None if value is None else bool(value)
    except (TypeError, ValueError):
        return None


def _not(value: Truth) -> Truth:
    return None if value is None else not value


def _joined(values: list[Truth], both: bool) -> Truth:
    """Kleene's and, or his or."""
    if (not both) in values:
        return not both
    return None if None in values else both


def _compared(sign: Callable[[Any, Any], Any], left: Any, right: Any) -> Truth:
    left, right = _plain(left, right), _plain(right, left)
    if left is None or right is None:
        return None
    try:
        return _truth(sign(left, right))
    except (TypeError, ValueError):  # a text beside a number, arrays of two sizes: nobody knows
        return None


def _plain(value: Any, beside: Any) -> Any:
    return value.name if isinstance(value, Enum) and isinstance(beside, str) else value


def _calculated(calculate: Callable[[Any, Any], Any], left: Any, right: Any) -> Any:
    """Of numbers alone: a text times a number could fill the memory."""
    if not (isinstance(left, Real) and isinstance(right, Real)):
        return None
    try:
        return calculate(left, right)
    except (ZeroDivisionError, OverflowError):
        return None


@dataclass(frozen=True)
class Violation:
    """A rule was broken, from one tick on.

    Attributes:
        rule: its name.
        tick: the first tick in which it was, from 0.
        reason: what its names held then.
    """

    rule: str
    tick: int
    time_s: float
    reason: str

    def __str__(self) -> str:
        return f"tick {self.tick} at {self.time_s:.2f} s: {self.rule}: {self.reason}"


@dataclass
class Watched:
    """A rule that is watched over the ticks of a run.

    Attributes:
        always: the expression must hold in every tick; else it must hold in none.
        broken: it is, or was when it was known last.
        ticks: in which it was kept, broken and unknown.
        unknown_since_s: since when it is unknown without a break; None where it is known.
    """

    name: str
    expression: Expression
    always: bool = False
    broken: bool = False
    ticks: tuple[int, int, int] = (0, 0, 0)
    unknown_since_s: float | None = None

    def step(self, tick: int, moment: Moment) -> Violation | None:
        """Take a tick; the violation that begins in it."""
        holds, before = self.expression(moment), self.broken
        kept, broken, unknown = self.ticks
        if holds is None:
            self.unknown_since_s = moment.time_s if self.unknown_since_s is None else self.unknown_since_s
            self.ticks = kept, broken, unknown + 1
            return None
        self.unknown_since_s, self.broken = None, holds is not self.always
        self.ticks = kept + (not self.broken), broken + self.broken, unknown
        return Violation(self.name, tick, moment.time_s, self.reason(moment)) if self.broken and not before else None

    def unknown_s(self, time_s: float) -> float:
        """For how long it is unknown."""
        return 0.0 if self.unknown_since_s is None else time_s - self.unknown_since_s

    def reason(self, moment: Moment) -> str:
        """What its names hold now."""
        held = [f"{name} = {_said(moment.value(name))}" for name in self.expression.names]
        for label in self.expression.nodes:
            held += [f"{label} {word}" for word, status in STATUSES.items() if moment.is_so(label, status)]
        return ", ".join(held) or "no node that it names runs"


def _said(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else "unknown" if value is None else shown(value)


@dataclass
class Nodes:
    """Which nodes run, and which ended in this tick, followed by the changes of their statuses.

    Args:
        labels: by uid, what a node may be called.
    """

    labels: Mapping[int, Iterable[str]]
    _running: set[int] = field(default_factory=set)
    _ended: set[tuple[int, Status]] = field(default_factory=set)
    _uids: dict[str, set[int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for uid, labels in self.labels.items():
            for label in labels:
                self._uids.setdefault(label, set()).add(uid)

    def follow(self, changes: Iterable[StatusChange]) -> None:
        """A tick's changes."""
        self._ended.clear()
        for change in changes:
            (self._running.add if change.new is RUNNING else self._running.discard)(change.uid)
            self._ended.add((change.uid, change.new))

    def is_so(self, label: str, status: Status) -> Truth:
        uids = self._uids.get(label)
        if uids is None:
            return None
        if status is RUNNING:
            return not uids.isdisjoint(self._running)
        return any((uid, status) in self._ended for uid in uids)

    def __contains__(self, label: str) -> bool:
        return label in self._uids

    def __iter__(self) -> Iterator[str]:
        return iter(self._uids)


def nodes_of(tree: Tree) -> Nodes:
    """The nodes of a tree by what they may be called: path, name and tag."""
    from btxml.testing import names_of

    return Nodes({node.uid: (*names_of(node), tree.origins[node.uid - 1].tag) for node in tree.nodes})
