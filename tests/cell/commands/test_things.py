"""`cell train holes|parts`: the command on a model card makes the same weights again."""

from __future__ import annotations

import shlex
from pathlib import Path

from cell.commands import things
from cell.commands.all_weights import steps_of_shipped


def test_the_command_on_a_card_names_the_data_that_was_learned_from() -> None:
    own = [Path("data/week 12"), Path("data/week13")]
    words = shlex.split(things._command("holes", "12m", 23, 0, own))
    assert [words[at + 1] for at, word in enumerate(words) if word == "--data"] == list(map(str, own))
    shipped = {step.words[0]: step.command for step in steps_of_shipped()}
    assert things._command("parts", "28m", 8, 0, ()) == shipped["parts"]
