"""Rows of a long evaluation: taken up again where it was cut short, never mixed with others."""

from __future__ import annotations

from pathlib import Path

import pytest

from cell.errors import InputError
from cell.fleet.row_file import RowFile


def test_rows_are_there_again_and_a_row_that_was_cut_short_is_not(tmp_path: Path) -> None:
    path = tmp_path / "new" / "rows.jsonl"
    first = RowFile(path, {"command": "faults"})
    first.add({"seed": 1})
    first.add({"seed": 2})
    path.write_text(path.read_text()[:-4])
    second = RowFile(path, {"command": "faults"})
    assert second.rows == [{"seed": 1}]
    second.add({"seed": 2})
    assert RowFile(path, {"command": "faults"}).rows == [{"seed": 1}, {"seed": 2}]


@pytest.mark.parametrize("text", ['{"rows_of": {"command": "other"}}\n', "a diary\n", "[]\n", "1\n"])
def test_a_file_of_something_else_is_refused_and_left_as_it_is(tmp_path: Path, text: str) -> None:
    path = tmp_path / "rows.jsonl"
    path.write_text(text)
    with pytest.raises(InputError, match=r"rows\.jsonl:1: .*name another file"):
        RowFile(path, {"command": "faults"})
    assert path.read_text() == text


def test_without_a_file_rows_are_kept_in_memory() -> None:
    rows = RowFile(None, {})
    rows.add({"seed": 1})
    assert rows.rows == [{"seed": 1}]


def test_a_folder_is_no_file_of_rows(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "rows.jsonl" / "below"):
        (tmp_path / "rows.jsonl").touch()
        with pytest.raises(InputError, match="cannot keep rows"):
            RowFile(path, {"command": "faults"})
