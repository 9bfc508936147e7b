"""`cell lab train`: the command on a model card makes the same network again."""

from __future__ import annotations

import shlex
from pathlib import Path

import pytest
from typer.main import get_command

from bracket_lab.commands.training.shipped import Step, steps_of_shipped
from bracket_lab.commands.training.tasks import TASKS, train_app
from bracket_lab.commands.training.weights import Training


def test_the_command_on_a_card_names_the_data_that_was_learned_from() -> None:
    own = [Path("data/week 12"), Path("data/week13")]
    words = shlex.split(Training(budget="12m", data=own).command("holes", epochs=23))
    assert words[:4] == ["cell", "lab", "train", "holes"]
    assert [words[at + 1] for at, word in enumerate(words) if word == "--data"] == list(map(str, own))
    assert words[words.index("--epochs") + 1] == "23"


@pytest.mark.parametrize("step", steps_of_shipped(), ids=lambda step: step.files[0])
def test_every_card_of_shipped_weights_can_be_typed_today(step: Step) -> None:
    words = list(step.words)
    command = get_command(train_app()).commands[words[0]]  # type: ignore[attr-defined]
    given = command.make_context(words[0], words[1:]).params
    asked = TASKS[words[0]].chosen(Training(**given))
    again = shlex.split(asked.command(words[0], epochs=given.get("epochs")))[4:]
    task = TASKS[words[0]]
    usual = ["--kind", task.kinds[0]] if "kind" in task.options else []
    budget = ["--budget", Training().budget]
    assert {*words[1:]} <= {*again, *usual}
    assert {*again} <= {*words[1:], *usual, *budget}
