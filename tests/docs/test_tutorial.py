"""What docs/tutorial.md tells its readers to type does what it says."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.docs.guide import Reader, steps

ANSWERS = {  # of a command, in words of the page
    "cell check trees/mine.xml  # status 2": "there is no node 'MoveToo'; did you mean 'MoveTo'?",
    "cell run trees/mine.xml --seed 1 --log runs/late.mcap  # status 1": "time is up after 2000 ms",
    "cell replay runs/first.mcap": "identical",
    "cell replay runs/late.mcap": "identical",
    "cell replay runs/late.mcap --tree trees/mine.xml  # status 1": "Timeout",
}


@pytest.mark.long
def test_edits_and_checks_of_the_tutorial_are_right(tmp_path: Path) -> None:
    reader = Reader(tmp_path)
    for step in steps("tutorial.md"):
        if step.kind != "console" or step.text.startswith(("cd ", "cell init", "cell check")):
            reader.do(step)
            assert ANSWERS.get(step.text, "") in reader.printed


@pytest.mark.slow
def test_the_tutorial_typed_as_printed_shows_what_it_says(tmp_path: Path) -> None:
    reader = Reader(tmp_path)
    done = steps("tutorial.md")
    assert set(ANSWERS) <= {step.text for step in done}
    for step in done:
        reader.do(step)
        assert ANSWERS.get(step.text, "") in reader.printed, step.text
