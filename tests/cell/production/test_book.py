"""One book of production: what is written once is read alike by every reader; effectiveness as ISO 22400-2 has it."""

from __future__ import annotations

import csv
import json
import sqlite3
from datetime import UTC, datetime, timedelta
from io import StringIO
from pathlib import Path
from typing import Any

import pytest

from bracket_cell.commands.main import main
from bracket_cell.log.report.report import production_html
from bracket_cell.production.book import VERSION, Book, RunRow, csv_lines
from bracket_cell.production.bookkeeper import Bookkeeper, Moment, Placements
from bracket_cell.production.effectiveness import Period
from bracket_cell.production.samples import Samples
from bracket_ground.errors import InputError
from tests.cell.log.report.outline import outline_of

MONDAY = datetime(2026, 11, 23, 6, 0, tzinfo=UTC)
CYCLE_S, CHANGE_S, WAIT_S = 60.0, 20.0, 12.0
IDEAL_S = {"g0": 40.0, "g1": 30.0}


def note(topic: str, **fields: Any) -> tuple[str, dict[str, Any]]:
    return topic, fields


def shift(book: Book, began: datetime, brackets: int, planned_day_s: float | None = None) -> Bookkeeper:
    """Brackets of 60 s each, g0 and g1 in turn, 20 s between; in each a question of 12 s; each fifth is wrong."""
    row = RunRow(f"{began:%d-%H}.mcap", began_utc=began.isoformat(), ideal_s=IDEAL_S, planned_day_s=planned_day_s)
    keeper, now_s = Bookkeeper(book, row), 0.0
    keeper.take(Moment(0.0, [], asked=[]))
    for number in range(1, brackets + 1):
        now_s += CHANGE_S
        keeper.take(Moment(now_s, [note("bracket", number=number, edge="begin", order="A")]))
        keeper.take(Moment(now_s + 10, [note("help", text="o1, please")], asked=[("help", "no o1")]))
        placed = [note("belief", edge=["o1", f"p{i}"], source="robot" if i < 3 else "seen") for i in range(1, 7)]
        keeper.take(Moment(now_s + 10 + WAIT_S, placed, asked=[]))
        variant = f"g{number % 2}"
        more = {"order": "A"} if variant == "g0" else {}
        now_s += CYCLE_S
        keeper.take(Moment(now_s, [note("bracket", number=number, edge="end", finished=True, goal=variant, **more)]))
    keeper.judge([{"correct": number % 5 != 0} for number in range(1, brackets + 1)])
    keeper.end("finished")
    return keeper


def test_a_week_agrees_in_page_csv_metrics_and_json() -> None:
    """7 days with 2 shifts of 20 brackets each: 280."""
    book = Book()
    book.order("A", "g0", 500, "", cancelled=False)
    keepers = [shift(book, MONDAY + timedelta(days=day, hours=8 * late), 20) for day in range(7) for late in (0, 1)]
    rows = book.brackets()
    table = list(csv.DictReader(StringIO("".join(csv_lines(rows)))))
    samples = {(name, *labels.values()): value for name, labels, value in Samples(book)()}
    page = production_html(book)
    outline_of(page)
    summaries: list[dict[str, Any]] = [keeper.report([]) for keeper in keepers]
    finished = sum(row["finished"] == "yes" for row in table)
    assert finished == 280
    assert samples["cell_brackets_total", "true"] == 280
    assert sum(row["finished"] is True for told in summaries for row in told["brackets"]) == 280
    assert page.count('<td class="w good">right</td>') + page.count('<td class="w bad">wrong</td>') == 280
    for who, name in (("robot", "robot_placements"), ("person", "human_placements")):
        by_csv = sum(int(row[who]) for row in table)
        by_json = sum(row[name] for told in summaries for row in told["brackets"])
        assert samples["cell_placements_total", who] == by_csv == by_json == 280 * (2 if who == "robot" else 4)
    assert samples["cell_questions_total",] == 280 == sum(told["asked"] for told in summaries)
    assert [order["done"] for order in book.orders()] == [140]
    assert sum(row["order"] == "A" for row in table) == 140, "what was built as g1 counts for no order of g0"
    assert page.count("not as A wants it") == 140


def test_the_effectiveness_of_two_days_is_as_worked_out_by_hand() -> None:
    """Monday: 10 brackets in 800 s of an hour planned. Tuesday: 20 in 1600 s, nothing planned: the run's time."""
    book = Book()
    shift(book, MONDAY, 10, 3600.0)
    shift(book, MONDAY + timedelta(days=1), 20)
    (_, monday), (_, tuesday) = Period.of(book).days
    assert monday.availability == pytest.approx(10 * (60 - 12) / 3600)
    assert monday.effectiveness == pytest.approx((5 * 40 + 5 * 30) / (10 * 48))
    assert (monday.produced, monday.inspected, monday.good) == (10, 10, 8)
    assert monday.oee == pytest.approx(480 / 3600 * 350 / 480 * 0.8)
    assert tuesday.availability == pytest.approx(20 * 48 / (20 * 80))
    assert tuesday.oee == pytest.approx(0.6 * 700 / 960 * 16 / 20)


def test_what_nobody_inspected_or_configured_is_not_known() -> None:
    book = Book()
    keeper = shift(book, MONDAY, 4)
    assert Period.of(book).whole.quality == 1.0
    for row in keeper.rows:
        row.correct = None
    alone = Book()
    run = alone.begin(RunRow("x.mcap", ideal_s={"g0": 40.0}))
    for row in keeper.rows:
        alone.write(run, row)
    whole = Period.of(alone).whole
    assert (whole.effectiveness, whole.quality, whole.oee) == (None, None, None)
    assert "not known" in production_html(alone)
    assert alone.inspected(run, 1, False)
    assert Period.of(alone).whole.quality == 0.0
    alone.write(run, keeper.rows[0])
    assert Period.of(alone).whole.quality == 0.0, "an inspection stays where its row is written again"
    assert not alone.inspected(run, 9, True)


def test_equal_work_with_a_wait_loses_it_once() -> None:
    book = Book()
    shift(book, MONDAY, 2)
    whole = Period.of(book).whole
    assert (whole.availability or 0) * (whole.effectiveness or 0) == pytest.approx((40 + 30) / (2 * 80))


def test_a_hole_that_a_person_emptied_and_filled_anew_is_theirs() -> None:
    placements = Placements()
    placements.note("verdict", {"decision": "act", "part": "o1", "position": "p2"})
    placements.note("belief", {"edge": ["o1", "p2"], "source": "seen"})
    assert placements.by == {"p2": "robot"}
    placements.note("belief", {"edge": [None, "p2"]})
    placements.note("belief", {"edge": ["o1", "p2"], "source": "seen"})
    assert placements.by == {"p2": "person"}


def test_a_book_is_kept_and_read_by_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "book.sqlite"
    book = Book(path)
    shift(book, MONDAY, 3)
    book.close()
    assert main(["report", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["report"] == str(tmp_path / "book.html")
    assert len((tmp_path / "book.csv").read_text().splitlines()) == 4
    assert "OEE" in (tmp_path / "book.html").read_text()
    assert main(["report", str(tmp_path / "none.sqlite")]) == 2
    assert "there is no such book" in capsys.readouterr().err


def test_other_files_and_later_versions_are_refused_with_their_place(tmp_path: Path) -> None:
    later, other, text = tmp_path / "later.sqlite", tmp_path / "other.sqlite", tmp_path / "text.sqlite"
    for path, version in ((later, VERSION + 1), (other, 0)):
        with sqlite3.connect(path) as file:
            file.execute("CREATE TABLE mine (x)")
            file.execute(f"PRAGMA user_version = {version}")
    text.write_text("hello " * 100)
    for path in (later, other, text):
        with pytest.raises(InputError, match=f"{path.name}.*cannot be used as a book"):
            Book(path)


def test_a_run_that_goes_on_is_one_run_with_the_first(tmp_path: Path) -> None:
    book = Book(tmp_path / "book.sqlite")
    first = Bookkeeper(book, RunRow("a.mcap"))
    first.take(Moment(0.0, [note("bracket", number=1, edge="begin")]))
    first.take(Moment(30.0, []))
    again = Bookkeeper(book, RunRow("a.mcap"))
    again.take(Moment(0.0, [note("bracket", number=1, edge="begin")]))
    again.take(Moment(30.0, []))
    again.take(Moment(1.0, [note("bracket", number=1, edge="begin", resumed=True)]))
    again.take(Moment(11.0, [note("bracket", number=1, edge="end", finished=True, goal="g0")]))
    again.end("finished")
    (row,) = book.brackets()
    assert (row.finished, row.length_s) == (True, 40.0)
    assert [(run.ended, run.seconds) for run in book.runs()] == [("finished", 40.0)]


@pytest.mark.parametrize("name", ["=1+1", "+x", "@x", 'a"b', "a,b"])
def test_a_table_holds_no_formula_and_reads_back(name: str) -> None:
    book = Book()
    keeper = Bookkeeper(book, RunRow("a.mcap"))
    keeper.take(Moment(0.0, [note("bracket", number=1, edge="begin", order=name)]))
    keeper.end("finished")
    (row,) = csv.DictReader(StringIO("".join(csv_lines(book.brackets()))))
    assert row["ordered"] in (name, f"'{name}")
    assert not row["ordered"].startswith(("=", "+", "@"))
