"""Rules: what each operator means, what is refused, and where they are checked."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bracket_cell.commands.main import main
from bracket_cell.log.read.reader import read_log
from bracket_cell.trees import Bench
from bracket_cell.trees.rules import Situation, load_rules
from bracket_ground.errors import InputError
from btxml.engine.status import Status
from btxml.rules import Expression, RuleError, Truth, Watched
from tests import ROOT

TREE = """<root BTCPP_format="4" main_tree_to_execute="Mine">
  <BehaviorTree ID="Mine">
    <Sequence>
      <Script code="tries := 0"/>
      <ActivateGripper/>
      <Script code="tries += 1"/>
      <MoveTo pose="look"/>
      <MoveTo name="home" pose="park"/>
    </Sequence>
  </BehaviorTree>
</root>
"""
RULES = """rules:
  - name: moves after activation
    always: implies(running("MoveTo"), once(60, succeeded("ActivateGripper")))
  - name: tries once
    never: tries > 1
  - name: goes home soon
    never: held(0.3, running("MoveTo"))
"""


@dataclass
class Facts:
    """A tick in which p, q and n are known or not."""

    time_s: float
    facts: dict[str, Any]

    def value(self, name: str) -> Any:
        return self.facts.get(name)

    def is_so(self, node: str, status: Status) -> Truth:  # noqa: ARG002
        return None


def answers(text: str, trace: Sequence[Facts]) -> list[Truth]:
    expression = Expression(text)
    return [expression(moment) for moment in trace]


def drawn(seed: int) -> list[Facts]:
    draw, now_s, trace = random.Random(seed), 0.0, list[Facts]()
    for _ in range(40):
        now_s += draw.choice((0.25, 0.5, 1.0))
        trace.append(Facts(now_s, {"p": draw.random() < 0.6, "q": draw.random() < 0.2, "n": draw.randint(0, 4)}))
    return trace


@pytest.mark.parametrize("seed", range(50))
def test_operators_mean_what_their_definitions_say_of_the_whole_trace(seed: int) -> None:
    trace = drawn(seed)
    times, p, q = ([facts.time_s for facts in trace], *([facts.facts[name] for facts in trace] for name in "pq"))
    told = [answers(text, trace) for text in ("once(2, p)", "held(2, p)", "since(p, q)", "began(p)")]
    for place, (now_s, once, held, since, began) in enumerate(zip(times, *told, strict=True)):
        past = range(place + 1)
        assert once is any(p[i] and now_s - times[i] <= 2 for i in past)
        whole = [i for i in past if all(p[i : place + 1]) and now_s - times[i] >= 2]
        assert held is bool(whole)
        assert since is any(q[i] and all(p[i + 1 : place + 1]) for i in past)
        assert began is (p[place] and not (place and p[place - 1]))


@pytest.mark.parametrize("seed", range(20))
def test_laws_of_logic_hold_in_every_tick(seed: int) -> None:
    trace = drawn(seed)
    for left, right in (
        ("not (p and q)", "not p or not q"),
        ("implies(p, q)", "not p or q"),
        ("not once(3, not p)", "once(3, p) and not once(3, not p)"),
        ("once(2, once(1, p))", "once(2, once(1, p)) or p"),
        ("1 < n <= 3", "n > 1 and n <= 3"),
        ("-n + 2 == 2 - n", "n == n"),
    ):
        assert answers(left, trace) == answers(right, trace)


@pytest.mark.parametrize("text", ["p", "p == q", "p < 1", "not p", "p + 1 > 0", "once(5, p)", "implies(p, q)"])
@pytest.mark.parametrize(
    "value", [np.zeros(3), np.zeros((2, 2)), object(), [1, 2]], ids=["row", "table", "any", "list"]
)
def test_what_an_entry_may_hold_ends_no_run(text: str, value: Any) -> None:
    assert answers(text, [Facts(0.0, {"p": value, "q": np.ones(2)})])[0] in (None, True, False)


def test_only_numbers_are_calculated_with() -> None:
    """A rule of a log is a stranger's: this text would be 4 GB long."""
    assert answers('"x" * 999999 * 4999 == "y"', [Facts(0.0, {})]) == [None]
    assert answers("n * 2 > 5", [Facts(0.0, {"n": np.int64(3)})]) == [True]


def test_what_is_unknown_is_neither_kept_nor_broken() -> None:
    trace = [Facts(0.0, {}), Facts(1.0, {"p": True}), Facts(2.0, {"p": False})]
    assert answers("p", trace) == [None, True, False]
    assert answers("p and q", trace) == [None, None, False]
    assert answers("p or q", trace) == [None, True, None]
    assert answers("once(5, p)", trace) == [None, True, True]
    assert answers("held(1, p)", trace) == [None, False, False]
    assert answers("n > 1", trace) == [None] * 3
    assert answers("'a' < 3", trace) == [None] * 3
    assert answers("1 / 0 > 1", trace) == [None] * 3


@pytest.mark.parametrize(
    "text",
    [
        *("", "p and", "__import__('os')", "open('x')", "p.__class__()", "[p]", "lambda: p", "p if q else n", "x := p"),
        *(
            "once(p, 3)",
            "once(-1, p)",
            "once(3)",
            "held(True, p)",
            "running(p)",
            "running('a', 'b')",
            "f(p)",
            "p" * 2001,
        ),
        *("(" * 200 + "p" + ")" * 200 + " and", "not " * 60 + "p", "p @ q", "{}", "f'{p}'", "p[0]", "*p", "1j", "b'a'"),
        "once(s=3, A=p)",
    ],
)
def test_what_is_no_rule_is_refused_and_nothing_runs(text: str) -> None:
    with pytest.raises(RuleError):
        Expression(text)


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    (tmp_path / "mine.xml").write_text(TREE)
    (tmp_path / "mine.rules.yaml").write_text(RULES)
    return tmp_path / "mine.xml"


def test_a_bench_tells_each_violation_once_with_tick_and_reason(tree: Path) -> None:
    bench = Bench(tree, {"MoveTo": "RRRRRRRRRRS"})
    for _ in range(15):
        bench.tick(0.04)
    (found,) = bench.violations
    assert str(found) == "tick 8 at 0.36 s: goes home soon: MoveTo running"
    bench = Bench(tree, {"MoveTo": "RS"})
    assert [bench.tick(0.04) for _ in range(3)] == ["R", "R", "S"]
    assert bench.violations == []


def test_a_tree_that_is_broken_on_purpose_breaks_its_rule(tree: Path) -> None:
    early = '<MoveTo pose="look"/>\n      <ActivateGripper/>'
    tree.write_text(TREE.replace("<ActivateGripper/>", early))
    bench = Bench(tree, {"MoveTo": "RS"})
    bench.tick(0.04)
    assert [found.rule for found in bench.violations] == ["moves after activation"]


@pytest.mark.parametrize(
    ("rule", "told"),
    [
        ('never: running("MoveToo")', ":2:5: the tree has no node 'MoveToo'; did you mean 'MoveTo'?"),
        ("never: trys > 1", ":2:5: the tree has no entry 'trys'; did you mean 'tries'?"),
        ("never: gripper.opening > 1", ":2:5: there is no state 'gripper.opening'; did you mean 'gripper.opening_m'?"),
        ("never: tries >", "of the rule: cannot be read"),
        ("never: tries > 1\n    always: tries < 1", "give either never or always"),
    ],
)
def test_check_finds_what_a_rule_names_and_the_tree_lacks(
    tree: Path, rule: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    tree.with_suffix(".rules.yaml").write_text(f"rules:\n  - {rule}\n    name: a\n")
    assert main(["check", str(tree), "--no-config"]) == 2
    assert told in capsys.readouterr().err


def test_check_tells_which_rule_can_never_be_broken(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(tree), "--no-config"]) == 0
    tree.with_suffix(".rules.yaml").write_text("rules:\n  - {name: a, never: 1 > 2}\n")
    assert main(["check", str(tree), "--no-config"]) == 1
    assert "this rule can never be broken: it names nothing" in capsys.readouterr().err


def test_two_rules_cannot_have_one_name(tmp_path: Path) -> None:
    path = tmp_path / "a.rules.yaml"
    path.write_text("rules:\n  - {name: a, never: x}\n  - {name: a, never: y}\n")
    with pytest.raises(InputError, match="'a' is there already"):
        load_rules(path)


def test_what_devices_do_is_unknown_without_them() -> None:
    assert Situation(0.0).value("arm.moving") is None
    assert Situation(0.0).value("tool.z_m") is None


def test_logs_are_judged_tick_by_tick(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, rules = ROOT / "tests/cases/assembly-g2-seed3.mcap", tmp_path / "a.rules.yaml"
    rules.write_text(
        "rules:\n"
        "  - {name: opens low, never: command.opens and tool.z_m > 0.4}\n"
        '  - {name: is active first, always: \'implies(running("PickPart"), once(600, running("MoveTo")))\'}\n'
        "  - {name: nobody, always: 'running(\"Nobody\")'}\n"
    )
    assert main(["log", "rules", str(log), "--rules", str(rules)]) == 1
    told, all_ticks = capsys.readouterr().out, f"({len(read_log(log).ticks)})"
    assert "tick 57 at 2.28 s: opens low: command.opens = True, tool.z_m = 0.4" in told
    assert "is active first: " not in told
    assert [line.split()[-6:] for line in told.splitlines() if line.startswith(("is active", "nobody"))] == [
        ["1", all_ticks, "0", "(0)", "0", "(0)"],
        ["0", "(0)", "0", "(0)", "1", all_ticks],
    ]


def test_a_broken_rule_that_is_unknown_stays_broken() -> None:
    watched = Watched("r", Expression("p"), always=True)
    trace = [{"p": True}, {"p": False}, {}, {}, {"p": True}, {}]
    steps = [watched.step(n, Facts(float(n), entries)) is not None for n, entries in enumerate(trace)]
    assert (steps, watched.ticks) == ([False, True, False, False, False, False], (2, 1, 3))
    assert watched.unknown_s(7.0) == 2.0
    seen = Watched("r", Expression("p"), always=True)
    assert [(seen.step(n, Facts(float(n), entries)), seen.broken)[1] for n, entries in enumerate(trace)] == [
        *(False, True, True, True, False, False)
    ]


def test_check_notes_a_rule_that_is_unknown_at_first(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rules = "rules:\n  - {name: few, never: tries > 9, action: hold, unknown_after_s: 3}\n"
    tree.with_suffix(".rules.yaml").write_text(rules)
    assert main(["check", str(tree), "--no-config"]) == 0
    told = "note: rule 'few' is unknown, and not kept, until tries is written, and holds the cell after 3 s of that"
    assert told in capsys.readouterr().err
