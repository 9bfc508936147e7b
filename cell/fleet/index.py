"""The runs of a folder as a table: a small Parquet file for each log, and SQL over all of them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from cell.fleet.extra import needed
from cell.fleet.table import write_table
from cell.interfaces.errors import InputError, LogError
from cell.log.reading.heading import run_row
from cell.recording.parts import part_number, whole_path

FOLDER = "rows"  # beside the logs
LISTED = 'started_utc, log, product, goal, seed, "end", correct, sim_time_s, robot_placements, help_requests'

ASKING = frozenset({"SELECT", "MULTI"})  # statements, in DuckDB's words; those that pivot are several

Answer = tuple[list[str], list[tuple[Any, ...]]]


def add_run(log: Path) -> Path:
    """Write the row of one log; the file is there whole or not at all.

    Raises:
        InputError, LogError: it cannot be read or written.
    """
    target = log.parent / FOLDER / f"{whole_path(log).stem}.parquet"
    write_table([run_row(log)], target)
    return target


def refresh(folder: Path) -> list[str]:
    """Write the rows that are missing or older than their logs; says which logs cannot be read, and why."""
    problems = []
    for log in _logs(folder):
        row = folder / FOLDER / f"{whole_path(log).stem}.parquet"
        if not row.exists() or row.stat().st_mtime < log.stat().st_mtime:
            try:
                add_run(log)
            except LogError as error:
                problems.append(str(error))
    return problems


def ask(folder: Path, sql: str) -> Answer:
    """Names of the columns, and rows; the table is `runs`. No file but its rows is read, and none is written.

    Raises:
        InputError: DuckDB is not installed, there is no run, the question is wrong, or it is more than a question.
    """
    duckdb = needed("duckdb", "a question about many runs")
    rows = (folder / FOLDER).resolve()
    if not any(rows.glob("*.parquet")):
        raise InputError(f"{folder}: holds no log")
    try:
        with duckdb.connect() as database:
            database.execute(
                f"create view runs as select * from read_parquet('{_quoted(rows / '*.parquet')}', union_by_name = true)"
            )
            database.execute(f"set allowed_directories = ['{_quoted(rows)}']")
            database.execute("set enable_external_access = false; set lock_configuration = true")
            kinds = {statement.type.name for statement in database.extract_statements(sql)} - ASKING
            if kinds:
                what = f"it must only ask, as SELECT, FROM, DESCRIBE or PIVOT do, not {', '.join(sorted(kinds))}"
                raise InputError(f"the question cannot be answered: {what}")
            found = database.execute(sql)
            if found.description is None:
                return [], []
            return [column[0] for column in found.description], found.fetchall()
    except duckdb.Error as error:
        raise InputError(f"the question cannot be answered: {str(error).strip()}") from None


def listing(where: str | None, columns: str = LISTED) -> str:
    """SQL of the usual list, newest first."""
    return f"select {columns} from runs {f'where {where}' if where else ''} order by started_utc desc"


FAILURES = (
    "select failed_leaf, last_failure, count(*) as runs, min(log) as for_example from runs "
    "where \"end\" = 'failed' group by all order by runs desc"
)


def _logs(folder: Path) -> Iterator[Path]:
    """Whole logs, and the first part that is there of each rotated one."""
    seen = set()
    for path in sorted(folder.glob("*.mcap")):
        if path.name.endswith(".recovered.mcap"):
            continue
        whole = whole_path(path) if part_number(path) is not None else path
        if whole not in seen:
            seen.add(whole)
            yield path


def _quoted(path: Path) -> str:
    return str(path).replace("'", "''")
