"""The book of production: one SQLite file beside the logs, written by each run, read by everything that tells of it.

Times within a run are of the cell's clock [s]; a run's beginning is UTC, so each time has its place on the wall.
"""

from __future__ import annotations

import json
import sqlite3
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from bracket_ground.errors import InputError, Place, Problem, words_of

NAME = "book.sqlite"
VERSION = 1  # of the schema, in `PRAGMA user_version`
MEMORY = ":memory:"
LOCKED_S = 5.0  # another process writes for no longer
BETWEEN = 0  # number of what belongs to no bracket
SCHEMA = """
CREATE TABLE runs (
  id INTEGER PRIMARY KEY, log TEXT NOT NULL, product TEXT NOT NULL, tree TEXT NOT NULL, operator TEXT NOT NULL,
  began_utc TEXT NOT NULL, seconds REAL NOT NULL DEFAULT 0, ideal_s TEXT NOT NULL, planned_day_s REAL,
  ended TEXT NOT NULL DEFAULT '', signal TEXT NOT NULL DEFAULT '', reason TEXT NOT NULL DEFAULT '');
CREATE TABLE brackets (
  run INTEGER NOT NULL REFERENCES runs, number INTEGER NOT NULL, begin_s REAL NOT NULL, end_s REAL NOT NULL,
  finished INTEGER, variant TEXT NOT NULL, ordered TEXT NOT NULL, order_id TEXT NOT NULL, correct INTEGER,
  known_wrong TEXT NOT NULL, placed TEXT NOT NULL, questions TEXT NOT NULL, robot INTEGER NOT NULL,
  person INTEGER NOT NULL, PRIMARY KEY (run, number));
CREATE TABLE waits (
  run INTEGER NOT NULL REFERENCES runs, number INTEGER NOT NULL, reason TEXT NOT NULL, seconds REAL NOT NULL,
  PRIMARY KEY (run, number, reason));
CREATE TABLE stops (
  run INTEGER NOT NULL REFERENCES runs, signal TEXT NOT NULL, times INTEGER NOT NULL, PRIMARY KEY (run, signal));
CREATE TABLE orders (
  id TEXT PRIMARY KEY, variant TEXT NOT NULL, amount INTEGER NOT NULL, due TEXT NOT NULL, cancelled INTEGER NOT NULL,
  placed_utc TEXT NOT NULL);
CREATE INDEX brackets_of_an_order ON brackets (order_id);
"""


@dataclass
class BracketRow:
    """One bracket.

    Attributes:
        begin_s, end_s: of the run's clock.
        finished: every hole was seen filled when it ended; None where the run ended before.
        variant: the goal that it was seen to be when it ended; empty if that is no listed one.
        ordered: id of the work order that was expected when it began; empty for none.
        order: id of the order that it counts for: of its own variant; empty for none.
        correct: as it was inspected; None where nobody did.
        placed: part type and who placed it, by position.
        questions: what was asked, in words.
        known_wrong: holes that the cell knew to be wrong when it ended.
        waits_s: seconds by reason in which the cell was held, or a question stood.
        run: number of the run in the book.
        began_utc: of the run.
    """

    number: int
    begin_s: float
    end_s: float
    finished: bool | None = None
    variant: str = ""
    ordered: str = ""
    order: str = ""
    correct: bool | None = None
    placed: dict[str, tuple[str, str]] = field(default_factory=dict)
    questions: list[str] = field(default_factory=list)
    known_wrong: list[str] = field(default_factory=list)
    waits_s: dict[str, float] = field(default_factory=dict)
    run: int = 0
    began_utc: str = ""

    @property
    def length_s(self) -> float:
        return self.end_s - self.begin_s

    @property
    def waited_s(self) -> float:
        return sum(self.waits_s.values())

    @property
    def robot(self) -> int:
        return sum(who == "robot" for _, who in self.placed.values())

    @property
    def person(self) -> int:
        return len(self.placed) - self.robot

    @property
    def misses_order(self) -> bool:
        """Whether it was finished as another variant than its order wanted."""
        return bool(self.finished and self.ordered and self.order != self.ordered)

    @property
    def begin_utc(self) -> datetime:
        return datetime.fromisoformat(self.began_utc) + timedelta(seconds=self.begin_s)

    @property
    def end_utc(self) -> datetime:
        return datetime.fromisoformat(self.began_utc) + timedelta(seconds=self.end_s)


@dataclass(frozen=True)
class RunRow:
    """One run.

    Attributes:
        log: its file.
        operator: who began it; empty if nobody said.
        seconds: how long it took.
        ideal_s: ideal cycle time by variant [s], as it was configured.
        planned_day_s: planned busy time of a day [s]; None where none is configured.
        ended: "finished", "failed", "timeout", "interrupted" or "fault"; empty while it goes on, and where it was
            killed.
        signal: that was there first where a fault ended it; empty for none.
    """

    log: str
    product: str = ""
    tree: str = ""
    operator: str = ""
    began_utc: str = ""
    seconds: float = 0.0
    ideal_s: Mapping[str, float] = field(default_factory=dict)
    planned_day_s: float | None = None
    ended: str = ""
    signal: str = ""
    reason: str = ""
    id: int = 0


class Book:
    """Opens a book; used from any thread.

    Args:
        path: None for a book in memory.

    Attributes:
        changes: rises with each order, bracket and inspection that this process writes.

    Raises:
        InputError: the file is no book, of a later version, or cannot be opened.
    """

    def __init__(self, path: Path | None = None) -> None:
        self.path, self._lock, self.changes = path, threading.Lock(), 0
        try:
            if path is not None:
                path.parent.mkdir(parents=True, exist_ok=True)
            self._file = sqlite3.connect(path or MEMORY, LOCKED_S, check_same_thread=False, isolation_level=None)
            self._prepare()
        except (OSError, sqlite3.Error) as error:
            problem = f"cannot be used as a book: {words_of(error)}"
            raise InputError(Problem(Place(path or Path(MEMORY)), problem)) from None

    def _prepare(self) -> None:
        self._file.execute("PRAGMA journal_mode = WAL")
        self._file.execute("PRAGMA synchronous = NORMAL")  # a commit does not wait for the disk
        self._file.execute("BEGIN IMMEDIATE")
        (version,) = self._file.execute("PRAGMA user_version").fetchone()
        tables = self._file.execute("SELECT 1 FROM sqlite_master LIMIT 1").fetchone()
        if version not in (0, VERSION) or (version == 0 and tables):
            self._file.execute("ROLLBACK")
            raise sqlite3.DatabaseError(f"its schema has version {version}, this program reads version {VERSION}")
        if version == 0:
            for statement in filter(str.strip, SCHEMA.split(";")):
                self._file.execute(statement)
            self._file.execute(f"PRAGMA user_version = {VERSION}")
        self._file.execute("COMMIT")

    @property
    def version(self) -> tuple[int, int]:
        """Another one after each change, whichever process made it."""
        (row,) = self.ask("PRAGMA data_version")
        return self.changes, int(row["data_version"])

    def close(self) -> None:
        """Harmless when repeated."""
        with self._lock:
            self._file.close()

    def begin(self, run: RunRow) -> int:
        """Write a run down; returns its number. One of the same log goes on with its number."""
        with self._lock:
            known = self._file.execute("SELECT id FROM runs WHERE log = ? AND log != ''", (run.log,)).fetchone()
            if known:
                self._file.execute("UPDATE runs SET ended = '', signal = '', reason = '' WHERE id = ?", known)
                return int(known[0])
            began = run.began_utc or datetime.now(UTC).isoformat(timespec="milliseconds")
            values = (run.log, run.product, run.tree, run.operator, began, json.dumps(dict(run.ideal_s)))
            insert = "INSERT INTO runs (log, product, tree, operator, began_utc, ideal_s, planned_day_s) VALUES"
            made = self._file.execute(f"{insert} (?, ?, ?, ?, ?, ?, ?)", (*values, run.planned_day_s))
            return int(made.lastrowid or 0)

    def lasted(self, run: int, seconds: float) -> None:
        """So long the run took until now."""
        self._write("UPDATE runs SET seconds = ? WHERE id = ?", (seconds, run))

    def end(self, run: int, seconds: float, ended: str, signal: str, reason: str) -> None:
        """The run is over."""
        to = "UPDATE runs SET seconds = ?, ended = ?, signal = ?, reason = ? WHERE id = ?"
        self._write(to, (seconds, ended, signal, reason, run))

    def write(self, run: int, row: BracketRow) -> None:
        """Write a bracket as it is now."""
        values = (row.finished, row.variant, row.ordered, row.order, row.correct)
        texts = (json.dumps(row.known_wrong), json.dumps(row.placed), json.dumps(row.questions))
        kept = "COALESCE(?, (SELECT correct FROM brackets WHERE run = ? AND number = ?))"  # as a person inspected it
        with self._lock, self._at_once():
            self._file.execute(
                f"INSERT OR REPLACE INTO brackets VALUES (?, ?, ?, ?, ?, ?, ?, ?, {kept}, ?, ?, ?, ?, ?)",
                (run, row.number, row.begin_s, row.end_s, *values, run, row.number, *texts, row.robot, row.person),
            )
            self._waits(run, row.number, row.waits_s)
        self.changes += 1

    def waited(self, run: int, waits_s: Mapping[str, float]) -> None:
        """Seconds by reason that the cell waited between brackets."""
        with self._lock, self._at_once():
            self._waits(run, BETWEEN, waits_s)

    def stopped(self, run: int, signal: str) -> None:
        """The arm was held, or the run stopped, once more."""
        upsert = "INSERT INTO stops VALUES (?, ?, 1) ON CONFLICT DO UPDATE SET times = times + 1"
        self._write(upsert, (run, signal))

    def inspected(self, run: int, number: int, correct: bool) -> bool:
        """Say of a bracket whether it is right; returns whether there is such one."""
        words = "UPDATE brackets SET correct = ? WHERE run = ? AND number = ? AND finished IS NOT NULL"
        found = self._write(words, (correct, run, number))
        self.changes += found
        return found > 0

    def order(self, id: str, variant: str, amount: int, due: str, *, cancelled: bool) -> None:
        """Write an order down, or its change."""
        now = datetime.now(UTC).isoformat(timespec="seconds")
        words = (
            "INSERT INTO orders VALUES (?, ?, ?, ?, ?, ?) ON CONFLICT DO UPDATE SET variant = excluded.variant, "
            "amount = excluded.amount, due = excluded.due, cancelled = excluded.cancelled"
        )
        self._write(words, (id, variant, amount, due, cancelled, now))
        self.changes += 1

    def orders(self) -> list[dict[str, Any]]:
        """All orders as they came, with what was finished of each."""
        words = (
            "SELECT id, variant, amount, due, cancelled, (SELECT count(*) FROM brackets WHERE order_id = orders.id "
            "AND finished) AS done FROM orders ORDER BY rowid"
        )
        return [{**row, "cancelled": bool(row["cancelled"])} for row in self.ask(words)]

    def runs(self, last: int | None = None) -> list[RunRow]:
        """Runs by their beginning, or the last of them."""
        limit = "" if last is None else f" ORDER BY id DESC LIMIT {int(last)}"
        rows = self.ask(f"SELECT * FROM (SELECT * FROM runs{limit}) ORDER BY began_utc, id")
        return [RunRow(**{**row, "ideal_s": json.loads(row["ideal_s"])}) for row in rows]

    def brackets(self, run: int | None = None, last: int | None = None) -> list[BracketRow]:
        """Brackets of all runs, or of one, or the last of them, by their beginning."""
        where, values = ("", ()) if run is None else (" WHERE run = ?", (run,))
        limit = "" if last is None else f" ORDER BY run DESC, number DESC LIMIT {int(last)}"
        found = self.ask(
            f"SELECT b.*, began_utc FROM (SELECT * FROM brackets{where}{limit}) b JOIN runs ON runs.id = b.run "
            "ORDER BY began_utc, run, number",
            values,
        )
        rows = [_bracket(row) for row in found]
        by_key = {(row.run, row.number): row for row in rows}
        for wait in self.ask(f"SELECT * FROM waits{where} ORDER BY rowid", values):
            if (row := by_key.get((wait["run"], wait["number"]))) is not None:
                row.waits_s[wait["reason"]] = wait["seconds"]
        return rows

    def waits_s(self, run: int | None = None) -> dict[str, float]:
        """Seconds by reason, those between brackets among them; the longest first."""
        where, values = ("", ()) if run is None else (" WHERE run = ?", (run,))
        words = f"SELECT reason, sum(seconds) AS s FROM waits{where} GROUP BY reason ORDER BY s DESC, reason"
        return {row["reason"]: row["s"] for row in self.ask(words, values)}

    def ask(self, words: str, values: Sequence[object] = ()) -> list[dict[str, Any]]:
        """Rows of a query, by column."""
        with self._lock, closing(self._file.execute(words, values)) as found:
            names = [column[0] for column in found.description]
            return [dict(zip(names, row, strict=True)) for row in found]

    def _waits(self, run: int, number: int, waits_s: Mapping[str, float]) -> None:
        rows: Iterable[tuple[object, ...]] = ((run, number, reason, length_s) for reason, length_s in waits_s.items())
        self._file.executemany("INSERT OR REPLACE INTO waits VALUES (?, ?, ?, ?)", rows)

    def _write(self, words: str, values: Sequence[object]) -> int:
        with self._lock:
            return self._file.execute(words, values).rowcount

    def _at_once(self) -> _Transaction:
        return _Transaction(self._file)


class _Transaction:
    """All of it is written, or nothing."""

    def __init__(self, file: sqlite3.Connection) -> None:
        self._file = file

    def __enter__(self) -> None:
        self._file.execute("BEGIN IMMEDIATE")

    def __exit__(self, kind: object, *_: object) -> None:
        self._file.execute("COMMIT" if kind is None else "ROLLBACK")


def csv_lines(rows: Iterable[BracketRow]) -> Iterator[str]:
    """A table of brackets as CSV, RFC 4180, the head first."""
    head = ("run", "number", "began", "ended", "seconds", "waited_s", "finished", "variant", "ordered", "order")
    yield ",".join((*head, "inspected", "robot", "person", "questions", "known_wrong")) + "\r\n"
    for row in rows:
        verdict = "" if row.correct is None else "right" if row.correct else "wrong"
        times = (row.begin_utc.isoformat(timespec="seconds"), row.end_utc.isoformat(timespec="seconds"))
        values = (row.run, row.number, *times, f"{row.length_s:.2f}", f"{row.waited_s:.2f}")
        made = ("" if row.finished is None else "yes" if row.finished else "no", row.variant, row.ordered, row.order)
        rest = (verdict, row.robot, row.person, len(row.questions), " ".join(row.known_wrong))
        yield ",".join(_quoted(str(value)) for value in (*values, *made, *rest)) + "\r\n"


def _quoted(text: str) -> str:
    """A field; a spreadsheet must not take a name for a formula."""
    text = f"'{text}" if text[:1] in ("=", "+", "-", "@") else text
    return '"' + text.replace('"', '""') + '"' if set(text) & set(',"\r\n') else text


def _bracket(row: Mapping[str, Any]) -> BracketRow:
    lists = {name: json.loads(row[name]) for name in ("placed", "questions", "known_wrong")}
    lists["placed"] = {at: tuple(list_) for at, list_ in lists["placed"].items()}
    known = {name: None if row[name] is None else bool(row[name]) for name in ("finished", "correct")}
    rest = {name: value for name, value in row.items() if name not in ("order_id", "robot", "person")}
    return BracketRow(**{**rest, **lists, **known, "order": row["order_id"]})
