"""`cell lab eval latency --untrained`: the time of an untrained network, which reaches no card."""

from __future__ import annotations

import pytest

from bracket_cell.commands.main import main
from bracket_lab.wiring.latency import answers_ms


@pytest.mark.parametrize(
    ("words", "said"),
    [(["--untrained", "lrcn"], "legal: slim, paper"), (["--untrained", "paper", "--note"], "leave --untrained out")],
)
def test_what_cannot_be_timed_is_told(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lab", "eval", "latency", *words]) == 2
    assert said in " ".join(capsys.readouterr().err.split())


def test_an_answer_about_the_tray_costs_all_that_is_done_with_its_image() -> None:
    rows = ("hands", "holes", "actions", "frame", "parts", "tray")
    found = {name: {"p50_ms": 1.0, "p95_ms": float(number)} for number, name in enumerate(rows)}
    assert answers_ms(found) == {"hands": 0.0, "holes": 1.0, "actions": 2.0, "parts": 5.0}
