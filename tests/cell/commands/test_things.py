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
    words = next(list(step.words) for step in steps_of_shipped() if step.words[0] == "parts")
    told = dict(zip(words[1::2], words[2::2], strict=True))
    again = things._command("parts", told["--budget"], int(told["--epochs"]), int(told["--seed"]), ())
    assert shlex.split(again) == ["cell", "train", *words]
