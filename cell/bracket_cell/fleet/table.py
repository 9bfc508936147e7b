"""Rows of runs as Parquet: one row a run, the same columns for every product, any SQL over them by DuckDB."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

from bracket_cell.packages import needed
from bracket_ground.errors import InputError
from bracket_ground.files.files import whole_or_none

Row = Mapping[str, Any]
BATCH = 5000  # rows in memory
PLAIN = frozenset({bool, int, float, str, type(None)})
ARROW = {bool: "bool_", int: "int64", float: "float64", str: "string"}
TEXTS = (
    "key run_id log started_utc site bench order_id end reason product goal goal_asked tree configuration person look "
    "fault commit perception limits state failed_leaf cause otherwise condition"
)
WHOLE = (
    "seed ticks overruns wrong_placements robot_placements human_placements help_requests contacts interventions moves"
)
NUMBERS = (
    "sim_time_s wall_time_s took_s cpu_s human_idle robot_idle concurrent functional_delay held_s failed_s "
    "slowed_s lost_alone_s"
)
COLUMNS: dict[str, type] = {
    **dict.fromkeys(TEXTS.split(), str),
    **dict.fromkeys(WHOLE.split(), int),
    **dict.fromkeys(NUMBERS.split(), float),
    **dict.fromkeys(("correct", "finished", "pixels"), bool),
}


def write_table(rows: Iterable[Row], path: Path) -> None:
    """Write rows; what is no number, text or yes and no becomes JSON text. The file is written atomically.

    Known columns are there in every table, with one type; what is empty, or does not fit, is null.

    Args:
        rows: gone through twice; a few thousand are in memory at a time.

    Raises:
        InputError: it cannot be written, or pyarrow is not installed.
    """
    arrow, parquet = needed("pyarrow", "a table of runs"), needed("pyarrow.parquet", "a table of runs")
    kinds: dict[str, set[type]] = {name: set() for name in COLUMNS}
    for row in rows:
        for name, value in row.items():
            kinds.setdefault(name, set()).add(kind if (kind := type(value)) in PLAIN else object)
    types = {name: COLUMNS.get(name) or _type(found - {type(None)}) for name, found in kinds.items()}
    schema = arrow.schema([(name, getattr(arrow, ARROW[kind])()) for name, kind in types.items()])
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_or_none(path) as partial, parquet.ParquetWriter(partial, schema) as writer:
            remaining = iter(rows)
            while batch := list(islice(remaining, BATCH)):
                columns = [_column(batch, name, kind, kinds[name]) for name, kind in types.items()]
                arrays = [arrow.array(column, field.type) for column, field in zip(columns, schema, strict=True)]
                writer.write_table(arrow.table(arrays, schema=schema))
    except OSError as error:
        why = os.strerror(error.errno) if error.errno else error  # Arrow has words of its own
        raise InputError(f"{path}: cannot be written: {why}") from None


def _column(batch: list[Row], name: str, kind: type, found: set[type]) -> list[Any]:
    """What a column holds of some rows; values that all have its type are only looked at where they may be empty."""
    values = [row.get(name) for row in batch]
    if not found <= {kind, type(None)}:
        return [as_type(value, kind) for value in values]
    return [value or None for value in values] if kind is str else values


def read_table(path: Path, columns: list[str] | None = None) -> list[dict[str, Any]]:
    """Rows of a Parquet file, with all columns or those that are named.

    Raises:
        InputError: it cannot be read.
    """
    arrow, parquet = needed("pyarrow", "a table of runs"), needed("pyarrow.parquet", "a table of runs")
    try:
        rows: list[dict[str, Any]] = parquet.read_table(path, columns=columns).to_pylist()
    except (OSError, arrow.ArrowException) as error:
        raise InputError(f"{path}: is not a table of runs: {str(error).splitlines()[0]}") from None
    return rows


def order_id(row: Row) -> str:
    """Ids of the work orders that a run's brackets were made for, by commas."""
    brackets = row.get("brackets") or ()
    return ", ".join(dict.fromkeys(str(bracket["order"]) for bracket in brackets if bracket.get("order")))


def as_type(value: object, kind: type) -> object:
    """A value as its column holds it; None for what is empty, or does not fit."""
    if type(value) is kind and value != "":
        return value
    value = _cell(value)
    if value is None or value == "":
        return None
    if kind is str:
        return str(value)
    if kind is bool:
        return value if isinstance(value, bool) else {"true": True, "false": False}.get(str(value).lower())
    try:
        number = float(str(value))
    except ValueError:
        return None
    return number if kind is float else int(number) if number == int(number) else None


def _cell(value: object) -> object:
    return value if value is None or isinstance(value, bool | int | float | str) else json.dumps(value, default=str)


def _type(kinds: set[type]) -> type:
    """One type for a column: whole numbers beside others become numbers, and what is mixed becomes text."""
    if kinds == {bool} or kinds == {int}:
        return next(iter(kinds))
    return float if kinds and kinds <= {int, float} else str
