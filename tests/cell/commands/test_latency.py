"""`cell eval latency --untrained`: how long a network takes that nobody has trained; nothing of it reaches a card."""

from __future__ import annotations

import pytest

from cell.commands.main import main


@pytest.mark.parametrize(
    ("words", "said"),
    [(["--untrained", "lrcn"], "legal: slim, paper"), (["--untrained", "paper", "--note"], "leave --untrained out")],
)
def test_what_cannot_be_timed_is_told(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["eval", "latency", *words]) == 2
    assert said in " ".join(capsys.readouterr().err.split())
