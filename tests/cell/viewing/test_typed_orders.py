"""What an operator types is the same as what the page says."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from bracket_ground.errors import InputError
from bracket_ground.interfaces.operator import OperatorOrder, Question
from bracket_ground.interfaces.planning import UNKNOWN_GOAL
from bracket_lab.evaluations.typed_orders import TypedOrders, order_of, typed_lines
from tests.cell.viewing.page.rig import HELP, WHICH


@pytest.mark.parametrize(
    ("line", "order"),
    [
        ("pause\n", OperatorOrder("pause", "now")),
        ("pause after part", OperatorOrder("pause", "after part")),
        ("resume", OperatorOrder("resume")),
        ("goal g1", OperatorOrder("goal", "g1")),
        ("goal new", OperatorOrder("goal", UNKNOWN_GOAL)),
        ("place o3", OperatorOrder("place", "o3")),
        ("ack", OperatorOrder("acknowledge")),
        ("finish", OperatorOrder("finish")),
        ("Stop", OperatorOrder("stop")),
        ("1 done", OperatorOrder("answer", "done", 1)),
        ("done", OperatorOrder("answer", "done", 1)),
        ("new", OperatorOrder("answer", UNKNOWN_GOAL, 2)),
        ("2 g0", OperatorOrder("answer", "g0", 2)),
        ("7 g0", OperatorOrder("answer", "g0", 7)),
    ],
)
def test_lines_are_orders(line: str, order: OperatorOrder) -> None:
    assert order_of(line, (HELP, WHICH)) == order


@pytest.mark.parametrize("line", ["dance", "done", "stop now", "resume 3"])
def test_others_are_told_what_there_is(line: str) -> None:
    questions: tuple[Question, ...] = ()
    with pytest.raises(InputError, match="there are acknowledge, answer"):
        order_of(line, questions)


def test_lines_come_from_a_pipe_whole() -> None:
    reading, writing = os.pipe()
    os.write(writing, b"pause\nres")
    os.write(writing, b"ume\nstop")
    os.close(writing)
    assert list(typed_lines(reading)) == ["pause", "resume", "stop"]
    os.close(reading)


def test_a_program_ends_while_nobody_types() -> None:
    program = (
        "from bracket_lab.evaluations.typed_orders import TypedOrders, typed_lines; import time;"
        "TypedOrders(typed_lines(0), print, tuple, print); time.sleep(0.3); print('ended')"
    )
    reading, writing = os.pipe()
    ended = subprocess.run([sys.executable, "-c", program], stdin=reading, capture_output=True, text=True, check=False)
    os.close(reading)
    os.close(writing)
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "ended\n", "")


def test_a_wrong_line_is_answered_and_the_next_one_obeyed() -> None:
    taken: list[OperatorOrder] = []
    said: list[str] = []
    typed = TypedOrders((), taken.append, lambda: (), said.append)
    for line in ("dance", "resume"):
        typed.take(line)
    assert taken == [OperatorOrder("resume")]
    assert "no order 'dance'" in said[0]


def test_a_text_keeps_its_capitals_and_needs_the_number() -> None:
    asked = (Question(4, "text", "which batch?"),)
    assert order_of("4 Batch 7b", asked) == OperatorOrder("answer", "Batch 7b", 4)
    assert order_of("stop", asked) == OperatorOrder("stop")
