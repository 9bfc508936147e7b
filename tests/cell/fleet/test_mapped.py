"""Calls on workers give what calls one by one give: in order, only as many as are wanted, errors as they are."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import pytest

from bracket_cell.fleet.engine import mapped
from bracket_ground.errors import CellError, InputError
from tests.cell.fleet import working


def test_one_worker_is_this_process_and_takes_what_is_wanted() -> None:
    taken: list[int] = []

    def numbers() -> Iterator[tuple[int]]:
        for number in range(9):
            taken.append(number)
            yield (number,)

    answers = mapped(math.factorial, numbers())
    assert [next(answers) for _ in range(3)] == [1, 1, 2]
    assert taken == [0, 1, 2]


@pytest.mark.long
def test_workers_answer_in_order_though_one_is_killed_and_an_error_is_what_the_call_raised(tmp_path: Path) -> None:
    marks = [(number, str(tmp_path / "killed") if number == 2 else "") for number in range(8)]
    found: list[int] = []
    answers = mapped(working.squared, iter([*marks, (-1, "")]), workers=2)
    with pytest.raises(InputError, match="no root: -1"):
        found.extend(answers)
    assert found == [number**2 for number in range(8)]
    assert (tmp_path / "killed").exists()


@pytest.mark.long
def test_a_call_that_kills_is_told_and_answers_count_though_workers_do_not_end_in_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    distributed = pytest.importorskip("distributed")
    close = distributed.LocalCluster.close

    def late(cluster: object) -> None:
        close(cluster)
        raise TimeoutError

    monkeypatch.setattr(distributed.LocalCluster, "close", late)
    answers = mapped(working.factorial, [(3,), (4,), (-1,)], workers=2)
    assert [next(answers), next(answers)] == [6, 24]
    with pytest.raises(CellError, match=r"lost again.*SIGKILL"):
        next(answers)
