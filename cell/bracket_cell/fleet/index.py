"""The runs of a folder as a table: one Parquet file that follows the logs, and SQL over it."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Iterable, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

from bracket_cell.fleet.intervals import mean, wilson
from bracket_cell.fleet.table import COLUMNS, read_table, write_table
from bracket_cell.packages import needed
from bracket_cell.recording.parts import PART, whole_path
from bracket_ground.errors import InputError, LogError, counted

Row = Mapping[str, Any]
MEANS = ("sim_time_s", "robot_placements", "help_requests", "contacts", "interventions", "human_idle", "robot_idle")
FOLDER = "rows"  # beside the logs
LISTED = 'started_utc, log, product, goal, seed, "end", correct, sim_time_s, robot_placements, help_requests'
ASKING = frozenset({"SELECT", "MULTI"})  # statements, in DuckDB's words; those that pivot are several
SQL = {bool: "boolean", int: "bigint", float: "double", str: "varchar"}
Answer = tuple[list[str], list[tuple[Any, ...]]]
TABLE, SEEN = "all.parquet", "seen_ns"  # and when a row's log was changed that it was made of
KEPT_NS = 1000  # the table keeps numbers of 53 bits: 256 ns of today's time
FAILURES = (
    'select log, state, failed_s, failed_leaf, cause, otherwise, "end", reason, condition, seed, pixels, perception, '
    "commit, limits from runs where \"end\" <> 'finished' or correct = false order by started_utc, log"
)


def summaries(rows: Iterable[Row], by: str) -> list[dict[str, Any]]:
    """For each value of the column: how many runs, how many right, their share, and means; each with its interval.

    Raises:
        InputError: no run has this column.
    """
    groups: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        if by not in row:
            raise InputError(f"runs have no column '{by}'; they have: {', '.join(sorted(row))}")
        groups[str(row[by])].append(row)
    return [{by: value, **_figures(group)} for value, group in sorted(groups.items())]


def _figures(rows: list[Row]) -> dict[str, Any]:
    """Right, wrong and not known apart; the share is of those that are known."""
    known = [row for row in rows if row.get("correct") is not None or row.get("end") not in ("finished", None)]
    right = sum(row.get("end") == "finished" and row.get("correct") is True for row in known)
    fields: dict[str, Any] = {"runs": len(rows), "right": right, "wrong": len(known) - right}
    fields |= {"not_known": len(rows) - len(known), "share": None, "share_low": None, "share_high": None}
    if known:
        share = wilson(right, len(known))
        fields |= {"share": share.value, "share_low": share.low, "share_high": share.high}
    for name in MEANS:
        values = [float(row[name]) for row in rows if isinstance(row.get(name), int | float)]
        if values:
            found = mean(values)
            fields |= {name: found.value}
            fields |= {f"{name}_low": found.low, f"{name}_high": found.high} if len(values) > 1 else {}
    return fields


def summary_lines(summary: Mapping[str, Any], by: str) -> list[str]:
    """One of the summaries in words."""
    share = "none is known"
    if summary["share"] is not None:
        share = f"{summary['share']:.3f} (95 %: {summary['share_low']:.3f} - {summary['share_high']:.3f})"
    counts = f"{summary['right']} right, {summary['wrong']} wrong, {summary['not_known']} not known"
    lines = [f"{by} {summary[by]}: {counted(summary['runs'], 'run')}, {counts}; {share}"]
    for name in filter(summary.__contains__, MEANS):
        low, high = summary.get(f"{name}_low"), summary.get(f"{name}_high")
        lines.append(f"  {name} {summary[name]:.2f}" + ("" if low is None else f" (95 %: {low:.2f} - {high:.2f})"))
    return lines


def rows_of(folder: Path) -> Path:
    """Where the rows of a folder's logs stand: in it, or among the user's own files where nobody may write there."""
    if os.access(folder / FOLDER if (folder / FOLDER).exists() else folder, os.W_OK):
        return folder / FOLDER
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return cache / "cell" / FOLDER / sha256(str(folder.resolve()).encode()).hexdigest()[:16]


def refresh(folder: Path) -> list[str]:
    """Bring the table up to the logs: those that are new, or grew, are read; says which cannot be, and why.

    Raises:
        InputError: the table cannot be written.
    """
    table, problems, new = rows_of(folder) / TABLE, [], dict[str, Row]()
    seen_ns = _seen_ns(table)
    logs = _logs(folder)
    grown = {log: ns for log, ns in logs.items() if seen_ns.get(log, -1) < ns - KEPT_NS}
    if not grown:
        return []
    from bracket_cell.fleet.run_row import run_row  # who only asks need not load what reads logs

    for log, changed_ns in grown.items():
        try:
            new[log] = {**run_row(Path(log)), SEEN: changed_ns}
        except LogError as error:
            problems.append(str(error))
    if new:
        known = read_table(table) if seen_ns else []
        write_table([*(row for row in known if row["log"] not in new), *new.values()], table)
        for log in logs:  # of a release that wrote a file for each log
            (table.parent / f"{whole_path(Path(log)).stem}.parquet").unlink(missing_ok=True)
    return problems


def _seen_ns(table: Path) -> dict[str, int]:
    """By log; a question with nothing new reads no more of the table than its own columns."""
    duckdb = needed("duckdb", "a question about many runs")
    if not table.exists():
        return {}
    try:
        with duckdb.connect() as database:
            return dict(database.execute(f"select log, {SEEN} from read_parquet('{_quoted(table)}')").fetchall())
    except duckdb.Error as error:
        raise InputError(f"{table}: is not a table of runs: {str(error).splitlines()[0]}") from None


def ask(folder: Path, sql: str) -> Answer:
    """Names of the columns, and rows; the table is `runs`. No file but its rows is read, and none is written.

    Raises:
        InputError: DuckDB is not installed, there is no run, the question is wrong, or it is more than a question.
    """
    duckdb = needed("duckdb", "a question about many runs")
    rows = rows_of(folder).resolve()
    if not any(rows.glob("*.parquet")):
        raise InputError(f"{folder}: holds no log")
    try:
        with duckdb.connect() as database:
            source = f"read_parquet('{_quoted(rows / '*.parquet')}', union_by_name = true)"
            there = [column[0] for column in database.execute(f"describe select * from {source}").fetchall()]
            casts = ", ".join(
                f"""try_cast(nullif(cast("{name}" as varchar), '') as {SQL[COLUMNS[name]]}) as "{name}\""""
                for name in there
                if name in COLUMNS  # rows of older versions have other types
            )
            lacking = "".join(
                f', cast(null as {SQL[kind]}) as "{name}"' for name, kind in COLUMNS.items() if name not in there
            )
            database.execute(f"create view runs as select * replace ({casts}){lacking} from {source}")
            database.execute(f"set allowed_directories = ['{_quoted(rows)}']")
            database.execute("set enable_external_access = false; set lock_configuration = true")
            kinds = {statement.type.name for statement in database.extract_statements(sql)} - ASKING
            if kinds:
                what = f"only queries are allowed (SELECT, FROM, DESCRIBE or PIVOT), not {', '.join(sorted(kinds))}"
                raise InputError(f"the query cannot be answered: {what}")
            found = database.execute(sql)
            if found.description is None:
                return [], []
            return [column[0] for column in found.description], found.fetchall()
    except duckdb.Error as error:
        raise InputError(f"the query cannot be answered: {str(error).strip()}") from None


def listing(where: str | None, columns: str = LISTED) -> str:
    """SQL of the usual list, newest first."""
    return f"select {columns} from runs {f'where {where}' if where else ''} order by started_utc desc"


def _logs(folder: Path) -> dict[str, int]:
    """Whole logs, and the first part that is there of each rotated one, with when any part was changed last [ns]."""
    found: dict[str, tuple[str, int]] = {}
    with os.scandir(folder) as entries:
        ours = (
            entry for entry in entries if entry.name.endswith(".mcap") and not entry.name.endswith(".recovered.mcap")
        )
        files = sorted((our.path, our.stat().st_mtime_ns) for our in ours)
    for path, changed_ns in files:  # as texts: there may be many thousand
        whole = PART.sub(".mcap", path)
        first, before_ns = found.get(whole, (path, 0))
        found[whole] = first, max(before_ns, changed_ns)
    return dict(found.values())


def _quoted(path: Path) -> str:
    return str(path).replace("'", "''")
