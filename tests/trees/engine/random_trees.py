"""Random trees of what BehaviorTree.CPP and this engine both support, with leaves that follow a script."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from xml.etree import ElementTree

CONDITIONS = (
    *("x > 1", "y == 0", "x != y", "x + y < 4", "x - y > 0", "true", "x == 0 || y > 2", "x * 2 >= y + 1", "!(x == y)"),
    *("-1 < x < 3", "x > 0 && y > 0 || x <= y", "'a' < 'b'", "'s' .. 't' == 'st'"),
    *("(2 | 1) == 3 && (6 ^ 3) == 5", "x > 1 ? y > 1 : y == 0", "-x + 0x2 > 0", "(~1) == -2", "6 & 3 == 2"),
)
CONDITIONS_OF_DATA = ("@x > 1", "@x == x", "@y - y < 1 && x >= 0", "s == 'ab' || y > 0", "x / 2 > 0.5e0")
CONDITIONS_OF_CONSTANTS = ("k > 2", "x < k", "k == 3 ? y > 0 : y == 0")
ASSIGNMENTS = (
    *("x := x + 1", "y := x - y", "x = 0", "y += 1; x := y > 2 ? 0 : x", "y -= 1", "x *= 2; x := x > 9 ? 1 : x"),
)
ASSIGNMENTS_OF_DATA = (
    *(
        "z := x",
        "z := y; x += 1",
        "@x += 1; @x := @x > 9 ? 0 : @x",
        "@y = x",
        "s := 'a' .. 'b'; x := s == 'ab' ? y : 0",
    ),
    *("s := 'c'", "x := x / 2 > 1 ? 3 : 0", "v := y + 1"),
)
ASSIGNMENTS_OF_CONSTANTS = ("x := k == 3 ? x : 2", "y := k > 2 ? 1 : 0")
# Texts that look like numbers beside numbers, bools that are counted with, and conditions that change what they ask.
CONDITIONS_OF_KINDS = (
    *(
        "t == 5",
        "'3' &lt; x",
        "x == '2'",
        "t &lt; 7 &amp;&amp; '10' &gt; 9",
        "b == 1",
        "b",
        "x + b &gt; 2",
        "t != '05'",
    ),
    *("x += 1; x &gt; 2", "t := '7'; t == 7", "y := x; y == x", "b := !b; b", "x = 0; y &gt; x"),
    *("&quot;a&quot; == 'a'", "t == '5' ? x : y", "(x | 1) &gt; 2", "-t &lt; 0", "0x5 == t"),
)
ASSIGNMENTS_OF_KINDS = (
    *("t := 5", "t := '5'; t = 6", "t := '8'", "x = '3'", "y := '4'; y = 2", "b := true; b += 1", "b = x &gt; y"),
    *("x := '2' * 3 &gt; 5 ? 1 : 0", "t := 'a' .. 'b'; t := '5'", "u := x; u := u * 2; x := u &gt; 8 ? 0 : u"),
)
# At typed ports: {n} is read as an int, {w} as a text; a LoopInt writes {i}, a LoopDouble {d}, a LoopBool {f}.
ASSIGNMENTS_OF_PORTS = (
    *("n := 3", "n := 1", "n = n + 1; n := n &gt; 3 ? 1 : n", "n := '2'", "n := true", "n := 4 / 2", "n := n / 2"),
    *("w := 2", "w := w + 1", "w = 0", "w += 1; x := w", "w := x", "w := w * 2; w := w &gt; 5 ? 0 : w"),
    *("i := 2", "i += 1", "i := i / 2", "d := 3", "d := d * 2", "f := true", "f := !f", "x := i + 1", "y := d &gt; 1"),
    *("i := 'a'", "d := '1.5'", "f := 'false'", "n := 'b' .. 'c'", "x := f ? 1 : 0", "i := 1.5"),
)
CONDITIONS_OF_PORTS = (
    *("n == 2", "n &gt; 1 ? x : y", "w == 1", "w &lt; 3", "i == 2", "i + n &gt; 3", "d &gt; 1", "f", "!f", "f == 1"),
    *("d == i", "w == 'a'", "n == '2'", "x == i"),
)
# At the typed ports of the judge's own leaves, and of SubTrees that rename: entries and constants.
TYPED_ENTRIES = ("n", "w", "i", "d", "f", "c", "l", "v")
READERS = ("Int", "Double", "Bool", "Text", "Colour", "Ints", "Doubles", "Texts")
WRITERS = (("Int", "ni"), ("Double", "d"), ("Bool", "f"), ("Text", "w"), ("Colour", "c"))
CONSTANTS_TYPED = {
    "Int": ("3", "-2", "true"), "Double": ("0.5", "2", "-1.25"), "Bool": ("true", "0", "False"), "Colour": ("RED", "2"),
    "Text": ("a b", "7"), "Ints": ("1;2", "json:[3, 4]"), "Doubles": ("0.5;2", "json:[1.5]"), "Texts": ("a;b",),
}  # fmt: skip
READ_OF = {
    "Int": "ni",
    "Double": "d",
    "Bool": "f",
    "Text": "w",
    "Colour": "c",
    "Ints": "l",
    "Doubles": "l",
    "Texts": "l",
}
ASSIGNMENTS_TYPED = (
    *("n := 3", "n += 1", "n := n &gt; 5 ? 0 : n", "i := n + 1", "d := n / 2", "d := 2", "f := n &gt; 1", "f := !f"),
    *("w := 'ab'", "w := '3'", "w := w .. 'x'", "c := GREEN", "c := RED", "l := '4;5'", "n := 2; i := n * n", "d *= 2"),
    *("@n := 1", "@n += 1; @n := @n &gt; 4 ? 0 : @n", "n = 0"),
)
CONDITIONS_TYPED = ("n == 2", "d &gt; 1", "f", "c == GREEN", "w == 'ab'", "i &gt;= n", "@n &lt; 3", "n + d &gt; 3")
AUTOREMAPS = ("true", "1", "True", "TRUE", "false", "0", "False")
CONTROLS = (
    *("Sequence", "Fallback", "ReactiveSequence", "ReactiveFallback", "SequenceWithMemory", "AsyncSequence"),
    *("AsyncFallback", "Parallel", "ParallelAll", "IfThenElse", "WhileDoElse", "Switch"),
)
DECORATORS = (
    *("Inverter", "ForceSuccess", "ForceFailure", "KeepRunningUntilFailure", "Repeat", "RunOnce", "SubTree"),
    *("RetryUntilSuccessful", "Precondition", "Loop"),
)
OF_CHILDREN = CONTROLS[:9]  # skipped where all of their children are
NEVER_SKIPPED = ("<Check", "<ScriptCondition", "<AlwaysSuccess", "<AlwaysFailure")
TIMED = ("Timeout", "Delay")
UPDATED = ("SkipUnlessUpdated", "WaitValueUpdate")
ATTRIBUTES_BEFORE = ("_failureIf", "_successIf")
ATTRIBUTES_AFTER = ("_onSuccess", "_onFailure", "_post")
QUEUES = (("Int", "1;2;3"), ("Double", "0.5;2"), ("Bool", "true;false"), ("String", "a;b"))
SWITCHES = (("{x}", ("0", "1", "2", "-1", "3", "5")), ("red", ("red", "blue", "RED", "", "1", "x")))
# Times are over at the next jump of the clock, or never within a case.
SHORT_MS, LONG_MS = 400, 3_600_000
VARIABLES = ("x", "y", "z", "v", "n", "w", "i", "d")


@dataclass(frozen=True)
class Features:
    """What the trees of a mode hold beside plain controls and decorators.

    Attributes:
        skips: nodes that are skipped.
        scripts: scripts and conditions.
        data: entries that are set, unset and waited for, the main tree's by `@`, constants passed to SubTrees.
        times: Timeout, Delay and Sleep.
        kinds: values of several types in one script, conditions that change entries, conditions of every kind in
            IfThenElse and WhileDoElse, `_autoremap` in all its spellings, `_onHalted`.
        ports: entries at the typed ports of the language's nodes: numbers of rounds, texts of a Switch, values of a
            Loop; scripts write them and read them.
        typed: leaves with typed ports of every kind, and SubTrees that rename what they pass.
    """

    skips: bool = False
    scripts: bool = False
    data: bool = False
    times: bool = False
    kinds: bool = False
    ports: bool = False
    typed: bool = False


@dataclass(frozen=True)
class Case:
    """A tree, the answers of its leaves in turn, and the ticks before which it is halted.

    Attributes:
        xml: the tree; every node has a name of its own.
        their_xml: the same for a library without TryCatch.
    """

    xml: str
    their_xml: str
    answers: Mapping[str, str]
    halts: frozenset[int]
    ticks: int


class Generator:
    """Draws one case."""

    def __init__(self, seed: int, size: int, features: Features) -> None:
        self._seed = seed
        self._random = random.Random(seed)
        self._timeouts = 0
        self._left = size
        self._features = features
        self._skips = features.skips  # whether nodes at this point of the tree may be skipped
        self._constants = False  # whether the tree at this point was passed {k}
        self._owns_v = True  # the library forgets an entry only in the tree that it belongs to
        self._subtrees: list[str] = []
        self._answers: dict[str, str] = {}

    def case(self, ticks: int = 20) -> Case:
        tree = self._body(0)
        subtrees = "".join(f'<BehaviorTree ID="T{i}">{body}</BehaviorTree>' for i, body in enumerate(self._subtrees))
        more = "; t := 5; b := true" if self._features.kinds else ""
        more += "; n := 2; w := 1; i := 0; d := 0.5; f := false" if self._features.ports else ""
        more += (
            "; n := 2; w := 'a'; i := 0; d := 0.5; f := false; c := BLUE; l := '1;2'" if self._features.typed else ""
        )
        start = f"<Script code=\"x := 0; y := 0; s := 'a'{more}\"/>"
        main = f'<BehaviorTree ID="Main"><Sequence><RunOnce>{start}</RunOnce>{tree}</Sequence></BehaviorTree>'
        root = ElementTree.fromstring(f'<root BTCPP_format="4" main_tree_to_execute="Main">{main}{subtrees}</root>')
        named(root, self._seed)
        xml = _text(root)
        _without_try_catch(root)
        halts = frozenset(i for i in range(1, ticks) if self._random.random() < 0.1)
        if "_onHalted" in xml:
            halts = frozenset()  # a halt from outside runs it there on nodes that never ran; a parent's halt does not
        return Case(xml, _text(root), self._answers, halts, ticks)

    def _body(self, depth: int) -> str:
        """A tree; its entry z has a writer, as this engine wants it, which never runs."""
        tree = self._node(depth)
        if not self._features.data:
            return tree
        writer = '<Sequence><ScriptCondition code="x &gt; 1000"/><Script code="z := 0; v := 0"/></Sequence>'
        return f"<Sequence><ForceSuccess>{writer}</ForceSuccess>{tree}</Sequence>"

    def _node(self, depth: int) -> str:
        self._left -= 1
        draw = self._random.random()
        if depth > 6 or self._left <= 0 or draw < 0.25:
            return self._leaf()
        return self._control(depth) if draw < 0.7 else self._decorator(depth)

    def _leaf(self) -> str:
        draw = self._random.random()
        if self._features.typed and draw < 0.5:
            return self._typed_leaf()
        if self._features.scripts and draw < 0.1:
            return self._script()
        if self._features.scripts and draw < 0.2:
            return f'<ScriptCondition code="{self._condition()}"/>'
        if self._features.data and draw < 0.35:
            return self._data_leaf()
        if self._features.times and draw < 0.2:
            return f'<Sleep msec="{self._time()}"/>'
        if self._random.random() < 0.05:
            return self._random.choice(("<AlwaysSuccess/>", "<AlwaysFailure/>"))
        letters = "SSSFFRRR" + ("K" if self._skips else "")
        return f'<Leaf name="{self._scripted(letters)}"{self._leaf_conditions()}{self._halted()}/>'

    def _typed_leaf(self) -> str:
        draw = self._random.random()
        if draw < 0.2:
            kind, entries = self._random.choice(WRITERS)
            return f'<Write{kind} v="{{{self._random.choice(entries)}}}"/>'
        if draw < 0.3:
            return self._random.choice(("<ReadOwn/>", '<ReadOwn n="{=}"/>', '<ReadOwn n="{i}" m="5"/>'))
        kind = self._random.choice(READERS)
        constant = self._random.random() < 0.25
        value = self._random.choice(CONSTANTS_TYPED[kind]) if constant else f"{{{self._random.choice(READ_OF[kind])}}}"
        return f'<Read{kind} v="{value}"/>'

    def _data_leaf(self) -> str:
        source, target = self._random.choice(("{x}", "{y}")), self._random.choice(("z", "v"))
        return self._random.choice(
            (
                f'<SetBlackboard value="{source}" output_key="{target}"/>',
                '<UnsetBlackboard key="v"/>' if self._owns_v else '<WasEntryUpdated entry="z"/>',
                '<WasEntryUpdated entry="{z}"/>',
                '<WasEntryUpdated entry="{x}"/>',
            )
        )

    def _check(self) -> str:
        """A condition: the library does not tick a finished action again before it is reset, as a py_trees leaf is."""
        return f'<Check name="{self._scripted("SF")}"/>'

    def _scripted(self, letters: str) -> str:
        name = f"leaf{len(self._answers)}.{self._seed}"
        self._answers[name] = "".join(self._random.choices(letters, k=self._random.randint(1, 9)))
        return name

    def _script_condition(self) -> str:
        return f'<ScriptCondition code="{self._condition()}"/>'

    def _script(self) -> str:
        return f'<Script code="{self._assignment()}"{self._leaf_conditions()}/>'

    def _control(self, depth: int) -> str:
        choices = CONTROLS if self._skips else (*CONTROLS, "TryCatch")
        tag = self._random.choice(choices)
        if tag in ("IfThenElse", "WhileDoElse"):
            branches = [self._node(depth + 1) for _ in range(self._random.randint(1, 2))]
            return self._element(tag, "", [self._asked(tag, depth, len(branches)), *branches])
        if tag == "Switch":
            return self._switch(depth)
        least = 2 if tag == "TryCatch" else 1
        children = [self._node(depth + 1) for _ in range(self._random.randint(least, 4))]
        ports = ""
        if tag == "Parallel":
            ports = f' success_count="{self._count(children)}" failure_count="{self._count(children)}"'
        if tag == "ParallelAll":
            ports = f' max_failures="{self._count(children)}"'
        return self._element(tag, ports, children)

    def _asked(self, tag: str, depth: int, branches: int) -> str:
        """The first child of IfThenElse or WhileDoElse.

        WhileDoElse ticks it again and again, and the library would not tick an action again; an IfThenElse with two
        children does not reset it there. Nothing in it is skipped, as the library then raises an exception.
        """
        if not self._features.kinds:
            return self._check()
        before, self._skips = self._skips, False
        asked: list[Callable[[], str]] = [self._check, self._script_condition, lambda: self._of_checks(depth)]
        if tag == "IfThenElse" and branches == 2:
            asked += [self._leaf, lambda: self._loop(depth)]
        element = self._random.choice(asked)()
        self._skips = before
        return element

    def _of_checks(self, depth: int) -> str:
        """A control or decorator over conditions alone."""
        tag = self._random.choice(("Sequence", "Fallback", "ReactiveSequence", "ReactiveFallback", "Inverter"))
        count = 1 if tag == "Inverter" else self._random.randint(1, 3)
        below = [self._check() if depth > 5 or self._random.random() < 0.7 else self._of_checks(depth + 1)]
        return f"<{tag}>{''.join([*below, *(self._check() for _ in range(count - 1))])}</{tag}>"

    def _switch(self, depth: int) -> str:
        """Switch2 to Switch6 on a number that scripts change, or on a text."""
        cases = self._random.randint(2, 6)
        variable, values = self._random.choice(SWITCHES)
        if self._features.ports:
            variable = self._random.choice(("{w}", variable))
        if self._features.data:  # the library makes {x} a string by it, and SetBlackboard then cannot copy it
            variable, values = SWITCHES[1]
        ports = f' variable="{variable}"'
        for number in range(1, cases + 1):
            ports += f' case_{number}="{self._random.choice(values)}"'
        return self._element(f"Switch{cases}", ports, [self._node(depth + 1) for _ in range(cases + 1)])

    def _count(self, children: list[str]) -> int:
        return self._random.choice((-1, self._random.randint(1, len(children))))

    def _decorator(self, depth: int) -> str:
        choices = (*DECORATORS, *(TIMED * 3 if self._features.times else ()), *(UPDATED if self._features.data else ()))
        tag = self._random.choice(choices)
        special: Mapping[str, Callable[[int], str]] = {
            "Precondition": self._precondition,
            "SubTree": self._subtree,
            "Loop": self._loop,
            "Timeout": self._timeout,
            "SkipUnlessUpdated": self._updated,
            "WaitValueUpdate": self._updated,
        }
        if tag in special:
            return special[tag](depth)
        if tag in ("Repeat", "RetryUntilSuccessful"):
            return self._rounds(tag, depth)
        ports = ""
        if tag == "RunOnce":
            ports = f' then_skip="{self._random.choice(("true", "false")) if self._skips else "false"}"'
        if tag == "Delay":
            ports = f' delay_msec="{self._time()}"'
        return self._element(tag, ports, [self._node(depth + 1)])

    def _timeout(self, depth: int) -> str:
        """No two that are over at once, one inside the other: in the library their threads would race."""
        time_ms = LONG_MS if self._timeouts else self._time()
        self._timeouts += 1
        element = self._element("Timeout", f' msec="{time_ms}"', [self._node(depth + 1)])
        self._timeouts -= 1
        return element

    def _time(self) -> int:
        return self._random.choice((SHORT_MS, SHORT_MS, LONG_MS))

    def _subtree(self, depth: int) -> str:
        self._subtrees.append("")
        number = len(self._subtrees) - 1
        joins = ['x="{x}" y="{y}" s="{s}"', '_autoremap="true"', 'x="{=}" y="{=}" s="{=}"', 'x="{y}" y="{x}" s="{s}"']
        if self._features.data:
            joins += ['x="{@x}" y="{y}" s="{s}" z="{z}"', 'x="{x}" y="{y}" s="{s}" k="3"', '_autoremap="true" k="1"']
        if self._features.ports:
            joins = ['_autoremap="true"', " ".join(f'{name}="{{=}}"' for name in "xysnwidf")]
        if self._features.typed:
            same = " ".join(f'{name}="{{=}}"' for name in "xyswdfcl")
            joins = [
                '_autoremap="true"',
                f'{same} n="{{n}}" i="{{i}}"',
                f'{same} n="{{i}}" i="{{n}}"',
                f'{same} n="3" i="{{n}}"',
            ]
            joins += [f'{same} n="{{@n}}" i="4"']
        if self._features.kinds:
            joins = [
                f'_autoremap="{self._random.choice(AUTOREMAPS)}" x="{{x}}" y="{{y}}" s="{{s}}" t="{{t}}" b="{{b}}"'
            ]
            joins += ['x="{x}" y="{y}" s="{s}" t="{t}" b="{b}"', '_autoremap="TRUE"', '_autoremap="1"']
        join = self._random.choice(joins)
        before = self._constants, self._owns_v
        self._owns_v = "_autoremap" not in join
        self._constants = 'k="' in join or ("_autoremap" in join and self._constants)
        self._subtrees[number] = self._body(depth + 1)
        self._constants, self._owns_v = before
        return f'<SubTree ID="T{number}" {join}{self._leaf_conditions()}/>'

    def _updated(self, depth: int) -> str:  # noqa: ARG002 - as the other decorators
        """Only with a child that finishes at once: the library does not halt it, this engine does."""
        tag = self._random.choice(UPDATED if self._skips else UPDATED[1:])
        child = self._random.choice((self._check(), self._script()))
        return self._element(tag, f' entry="{self._random.choice(("{z}", "{x}"))}"', [child])

    def _rounds(self, tag: str, depth: int) -> str:
        """Nothing below is skipped: the library keeps the count of a skipped Repeat, this engine begins anew."""
        before, self._skips = self._skips, False
        port = "num_cycles" if tag == "Repeat" else "num_attempts"
        number = "{n}" if self._features.ports and self._random.random() < 0.6 else self._random.randint(1, 4)
        element = self._element(tag, f' {port}="{number}"', [self._node(depth + 1)])
        self._skips = before
        return element

    def _loop(self, depth: int) -> str:
        """A queue that the file spells out."""
        kind, items = self._random.choice(QUEUES)
        number = sum(text.count("<Loop") for text in self._subtrees) + len(self._answers)
        empty = self._random.choice(("SUCCESS", "FAILURE"))
        entry = {"Int": "i", "Double": "d", "Bool": "f"}.get(kind) if self._features.ports else None
        ports = f' queue="{items}" value="{{{entry or f"item{kind}{number}"}}}" if_empty="{empty}"'
        return self._element(f"Loop{kind}", ports, [self._node(depth + 1)])

    def _precondition(self, depth: int) -> str:  # noqa: ARG002 - as the other decorators
        """Only with a child that finishes at once: the library does not ask again after a halt, this engine does."""
        if not self._features.scripts:
            return self._leaf()
        otherwise = self._random.choice(("FAILURE", "SUCCESS", "RUNNING", "SKIPPED")[: 4 if self._skips else 3])
        child = self._random.choice((self._check(), f'<Script code="{self._assignment()}"/>'))
        condition = self._random.choice(("x > 1", "y == 0", "x != y"))
        return self._element("Precondition", f' if="{_escaped(condition)}" else="{otherwise}"', [child])

    def _element(self, tag: str, ports: str, children: list[str]) -> str:
        """The library leaves a skipped control RUNNING, so that it does not ask the first three conditions again."""
        attributes = ("_while", *ATTRIBUTES_AFTER) if self._skips else (*ATTRIBUTES_BEFORE, *ATTRIBUTES_AFTER)
        asked = tag in OF_CHILDREN and any(child.startswith(NEVER_SKIPPED) for child in children)
        halted = self._halted() if asked or not self._skips else ""  # a skipped control is RUNNING there, and is halted
        return f"<{tag}{ports}{self._conditions(attributes)}{halted}>{''.join(children)}</{tag}>"

    def _halted(self) -> str:
        return ' _onHalted="y := 3"' if self._features.kinds and self._random.random() < 0.05 else ""

    def _leaf_conditions(self) -> str:
        skips = ("_skipIf", "_while") if self._skips else ()
        return self._conditions((*skips, *ATTRIBUTES_BEFORE, *ATTRIBUTES_AFTER))

    def _conditions(self, attributes: tuple[str, ...]) -> str:
        if not self._features.scripts or self._random.random() > 0.2:
            return ""
        name = self._random.choice(attributes)
        return f' {name}="{self._assignment() if name in ATTRIBUTES_AFTER else self._condition()}"'

    def _condition(self) -> str:
        if self._features.kinds and self._random.random() < 0.5:
            return self._random.choice(CONDITIONS_OF_KINDS)
        if self._features.ports and self._random.random() < 0.5:
            return self._random.choice(CONDITIONS_OF_PORTS)
        if self._features.typed and self._random.random() < 0.5:
            return self._random.choice(CONDITIONS_TYPED)
        more = CONDITIONS_OF_DATA if self._features.data else ()
        return _escaped(self._random.choice((*CONDITIONS, *more, *(CONDITIONS_OF_CONSTANTS * self._constants))))

    def _assignment(self) -> str:
        if self._features.kinds and self._random.random() < 0.5:
            return self._random.choice(ASSIGNMENTS_OF_KINDS)
        if self._features.ports and self._random.random() < 0.5:
            return self._random.choice(ASSIGNMENTS_OF_PORTS)
        if self._features.typed and self._random.random() < 0.5:
            return self._random.choice(ASSIGNMENTS_TYPED)
        more = ASSIGNMENTS_OF_DATA if self._features.data else ()
        return _escaped(self._random.choice((*ASSIGNMENTS, *more, *(ASSIGNMENTS_OF_CONSTANTS * self._constants))))


def _escaped(code: str) -> str:
    return code.replace("&", "&amp;").replace("<", "&lt;")


def named(root: ElementTree.Element, seed: int) -> None:
    """Give every node a name of its own, also beside other cases, so that both sides speak of the same ones."""
    for number, element in enumerate(root.iter()):
        if element.tag not in ("root", "BehaviorTree"):
            element.attrib.setdefault("name", f"{element.tag}{number}.{seed}")


def _without_try_catch(root: ElementTree.Element) -> None:
    """TryCatch as a Fallback of its work and a clean-up that fails; the nodes that are only there begin with `~`."""
    for element in list(root.iter("TryCatch")):
        *work, clean_up = list(element)
        for child in list(element):
            element.remove(child)
        element.tag = "Fallback"
        ElementTree.SubElement(element, "Sequence", name="~try").extend(work)
        ElementTree.SubElement(element, "ForceFailure", name="~catch").append(clean_up)


def _text(root: ElementTree.Element) -> str:
    return re.sub(r" />", "/>", ElementTree.tostring(root, encoding="unicode"))
