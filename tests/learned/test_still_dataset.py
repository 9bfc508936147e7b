"""Labelled images: what is no file of them is told with its name and line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from cell.errors import InputError
from learned.training.json_lines import labelled_rows
from learned.training.still_dataset import Still, load_stills


def unlabelled(still: Still, _row: dict[str, Any]) -> Still:
    return still


@pytest.mark.parametrize("content", [b"\xff\xfe\x00\x01", b"\x89PNG\r\n\x1a\n\x00\x80"])
def test_a_binary_file_is_told_by_its_name(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "holes.jsonl").write_bytes(content)
    with pytest.raises(InputError, match=r"holes\.jsonl.*cell lab data holes"):
        load_stills([tmp_path], "holes", unlabelled)


def test_a_missing_file_says_how_it_is_made(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cell lab data parts --out DIR"):
        load_stills([tmp_path], "parts", unlabelled)


@pytest.mark.parametrize("line", ["{", "[]", '{"log": "a"}', '{"file": "nothing.png", "log": "a"}'])
def test_a_wrong_row_is_told_by_its_line(tmp_path: Path, line: str) -> None:
    (tmp_path / "holes.jsonl").write_text("{}\n" + line + "\n")
    with pytest.raises(InputError, match=r"holes\.jsonl:2"):
        load_stills([tmp_path], "holes", unlabelled)
    with pytest.raises(InputError, match=r"holes\.jsonl:2"):
        labelled_rows(tmp_path, "holes", lambda row: row["file"] + str(row["hands"]))
