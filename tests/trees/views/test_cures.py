"""What an editor offers mends what is wrong: of each cure, the message that it belongs to is gone afterwards."""

from __future__ import annotations

from pathlib import Path

import pytest

from btxml.engine.errors import Problem
from btxml.files.check import Findings, findings
from btxml.views.cures import Cure, cures
from tests.trees.files.test_check import BAD_FILES, BAD_NODES, MAIN, REGISTRY

ROOT = '<root BTCPP_format="4" main_tree_to_execute="Main">\n  '
WRONG = [*(ROOT + MAIN.format(nodes) + "</root>" for nodes, _ in BAD_NODES), *(text for text, _ in BAD_FILES)]
FURTHER = [
    '<root BTCPP_format="4"><BehaviorTree ID="Go"><AlwaysSuccess/></BehaviorTree></root>',
    '<root BTCPP_format="3"><BehaviorTree ID="A"><AlwaysSuccess/></BehaviorTree></root>',
    '<root><BehaviorTree ID="A"><AlwaysSuccess/></BehaviorTree></root>',
    ROOT + MAIN.format('<Sequence _note="x" name="a"><Go place="{p}" colour="blue"/></Sequence>') + "</root>",
    ROOT
    + MAIN.format("<Inverter>\n<Sequense>\n<Sequense><AlwaysSuccess/></Sequense></Sequense></Inverter>")
    + "</root>",
    ROOT + MAIN.format('<SubTree ID="Elsewhere"/>') + "</root>",
]
# Of these only their author knows what was meant.
OPEN = (
    *("has no ID", "children", "1 child", "is not an int", "is not a float", "not the name of an entry", "bad script"),
    *("which cannot be written", "is not an entry", "which nothing writes", "contains itself", "asynchronous"),
    *("is never ticked", "before anything has written", "takes {p} as Place", "cannot be used", "stands between"),
    *("entities are refused", "is not a port", "needs port", "has 0 nodes", "no path", "there is no node"),
    *("is an enum name", "cannot be read", "not well-formed", "does not begin with <"),
)


def told(folder: Path, text: str) -> tuple[Findings, list[Problem]]:
    path = folder / "bad.xml"
    path.write_text(text)
    found = findings([path], REGISTRY)
    return found, [*found.problems, *found.warnings, *found.notes]


def applied(text: str, cure: Cure) -> str:
    for edit in sorted(cure.edits, reverse=True):
        text = text[: edit.start] + edit.text + text[edit.end :]
    return text


@pytest.mark.parametrize("marked", [*WRONG, *FURTHER])
def test_a_cure_mends_what_it_is_offered_for(tmp_path: Path, marked: str) -> None:
    text = marked.replace("^", "", 1)
    _, problems = told(tmp_path, text)
    for problem in problems:
        offered = cures(problem, text)
        assert offered or any(word in f"{problem.what}; {problem.legal}" for word in OPEN), problem
        for cure in offered:
            _, left = told(tmp_path, applied(text, cure))
            count = sum(one.what == problem.what for one in problems)
            assert sum(one.what == problem.what for one in left) < count, (problem, cure, applied(text, cure))
    (tmp_path / "bad.xml").unlink()


def test_most_messages_with_a_cure_end_clean(tmp_path: Path) -> None:
    """A misspelt element is written anew at both of its ends, however its like are nested."""
    text = FURTHER[4]
    for _ in range(2):
        _, problems = told(tmp_path, text)
        text = applied(text, cures(problems[0], text)[0])
    found, _ = told(tmp_path, text)
    assert found.problems == []
    assert text.count("Sequense") == 0
