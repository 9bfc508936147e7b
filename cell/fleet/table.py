"""Rows of runs as Parquet: one row a run, the same columns for every product, any SQL over them by DuckDB."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from cell.fleet.extra import needed
from cell.interfaces.errors import InputError

Row = Mapping[str, Any]


def write_table(rows: Sequence[Row], path: Path) -> None:
    """Write rows; what is no number, text or yes and no becomes JSON text. The file is there whole or not at all.

    Raises:
        InputError: it cannot be written, or pyarrow is not installed.
    """
    arrow, parquet = needed("pyarrow", "a table of runs"), needed("pyarrow.parquet", "a table of runs")
    columns = list(dict.fromkeys(name for row in rows for name in row))
    table = arrow.table({name: _column(arrow, [_cell(row.get(name)) for row in rows]) for name in columns})
    partial = path.with_name(path.name + ".partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        parquet.write_table(table, partial)
        partial.replace(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None


def read_table(path: Path) -> list[dict[str, Any]]:
    """Rows of a Parquet file.

    Raises:
        InputError: it cannot be read.
    """
    arrow, parquet = needed("pyarrow", "a table of runs"), needed("pyarrow.parquet", "a table of runs")
    try:
        rows: list[dict[str, Any]] = parquet.read_table(path).to_pylist()
    except (OSError, arrow.ArrowException) as error:
        raise InputError(f"{path}: is no table of runs: {str(error).splitlines()[0]}") from None
    return rows


def _cell(value: object) -> object:
    return value if value is None or isinstance(value, bool | int | float | str) else json.dumps(value, default=str)


def _column(arrow: Any, values: Iterable[object]) -> Any:
    """One type for a column: whole numbers beside others become numbers, and what is mixed becomes text."""
    values = list(values)
    kinds = {type(value) for value in values if value is not None}
    if kinds <= {int, float} and float in kinds:
        return arrow.array([None if value is None else float(str(value)) for value in values], arrow.float64())
    if len(kinds) > 1:
        return arrow.array([None if value is None else str(value) for value in values], arrow.string())
    if not kinds:
        return arrow.array(values, arrow.string())
    return arrow.array(values)
