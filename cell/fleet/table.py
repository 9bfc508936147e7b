"""Rows of runs as Parquet: one row a run, the same columns for every product, any SQL over them by DuckDB."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

from cell.errors import InputError
from cell.files.files import whole_or_none
from cell.files.packages import needed

Row = Mapping[str, Any]
BATCH = 5000  # rows in memory


def write_table(rows: Iterable[Row], path: Path) -> None:
    """Write rows; what is no number, text or yes and no becomes JSON text. The file is written atomically.

    Args:
        rows: gone through twice; a few thousand are in memory at a time.

    Raises:
        InputError: it cannot be written, or pyarrow is not installed.
    """
    arrow, parquet = needed("pyarrow", "a table of runs"), needed("pyarrow.parquet", "a table of runs")
    kinds: dict[str, set[type]] = {}
    for row in rows:
        for name, value in row.items():
            kinds.setdefault(name, set()).add(type(_cell(value)))
    schema = arrow.schema([(name, _type(arrow, found - {type(None)})) for name, found in kinds.items()])
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_or_none(path) as partial, parquet.ParquetWriter(partial, schema) as writer:
            remaining = iter(rows)
            while batch := list(islice(remaining, BATCH)):
                arrays = [_column(arrow, [_cell(row.get(field.name)) for row in batch], field.type) for field in schema]
                writer.write_table(arrow.table(arrays, schema=schema))
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None


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


def _cell(value: object) -> object:
    return value if value is None or isinstance(value, bool | int | float | str) else json.dumps(value, default=str)


def _type(arrow: Any, kinds: set[type]) -> Any:
    """One type for a column: whole numbers beside others become numbers, and what is mixed becomes text."""
    if kinds == {bool}:
        return arrow.bool_()
    if kinds == {int}:
        return arrow.int64()
    return arrow.float64() if kinds and kinds <= {int, float} else arrow.string()


def _column(arrow: Any, values: Iterable[object], kind: Any) -> Any:
    if kind == arrow.string():
        return arrow.array([None if value is None else str(value) for value in values], kind)
    if kind == arrow.float64():
        return arrow.array([None if value is None else float(str(value)) for value in values], kind)
    return arrow.array(list(values), kind)
