"""Shifts with work orders: late changes and a cancellation are told and followed; who builds otherwise is asked."""

from __future__ import annotations

import json
from io import StringIO
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from bracket_cell.running import work_orders
from bracket_cell.runs import assembled
from bracket_cell.runs import run as runs
from bracket_cell.runs.options import RunOptions
from bracket_ground.interfaces.operator import WorkOrder
from tests import ROOT
from tests.trees.nodes.rig import PRODUCT

VARIANTS = ("g0", "g1", "g2", "g0", "g1", "g2", "g0", "g1", "g2", "g0", "g1", "g2")
LATE: dict[int, dict[str, Any]] = {  # what comes when so many brackets are done
    2: {"id": "4", "variant": "g2"},
    5: {"id": "8", "amount": 2},
    6: {"id": "10", "cancelled": True},
}
BUILT = ("1", "2", "3", "4", "5", "6", "7", "8", "8", "9", "11", "12")


class Growing(work_orders.WorkOrders):
    """A file to which somebody adds lines while brackets are made."""

    _late = tuple(LATE.items())

    def open(self, time_s: float) -> tuple[WorkOrder, ...]:
        over = sum(row.finished is not None for row in self._book.brackets())
        while self._late and self._late[0][0] <= over and self._path:
            (_, line), *rest = self._late
            self._late = tuple(rest)
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")
        return super().open(time_s)


def shift(folder: Path, lines: list[dict[str, Any]], goal: str, brackets: int, **more: Any) -> tuple[Any, str]:
    """Summary of a shift without pictures, and what was said."""
    path, told = folder / "orders.jsonl", StringIO()
    path.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    options = RunOptions(
        tree=ROOT / "trees" / "shift.xml",
        goal=goal,
        seed=5,
        log=folder / "shift.mcap",
        brackets=brackets,
        max_duration_s=3000.0,
        pixels=False,
        images=False,
        work_orders=path,
        **more,
    )
    return runs.run(options, Console(file=told, soft_wrap=True, width=200)).summary, told.getvalue()


@pytest.mark.slow
def test_twelve_orders_with_two_changes_and_a_cancellation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(assembled, "WorkOrders", Growing)
    lines = [{"id": str(number), "variant": variant} for number, variant in enumerate(VARIANTS, 1)]
    wanted = {line["id"]: line["variant"] for line in lines} | {"4": "g2"}
    summary, told = shift(tmp_path, lines, ",".join(wanted[order] for order in BUILT), len(BUILT))
    rows = summary["brackets"]
    assert [row["order"] for row in rows] == list(BUILT)
    assert [row["goal"] for row in rows] == [wanted[order] for order in BUILT]
    assert (summary["right"], summary["wrong"], summary["unfinished"]) == (12, 0, 0)
    for news in (
        f"work order 4 was changed: 1 of {PRODUCT.goal_title('g2')}",
        f"work order 8 was changed: 2 of {PRODUCT.goal_title('g1')}",
        "work order 10 was cancelled",
    ):
        assert news in told


@pytest.mark.slow
def test_who_builds_against_the_order_is_asked_and_not_overruled(tmp_path: Path) -> None:
    summary, told = shift(tmp_path, [{"id": "A1", "variant": "g0", "amount": 1}], "g1", 1)
    assert "work order A1" in told.partition("asks")[2]
    (row,) = summary["brackets"]
    assert (row["goal"], row["correct"], row["order"]) == ("g1", True, "")
