"""Rows of many runs: taken up again where they were cut short, kept once, never mixed with others."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from bracket_ground.errors import InputError
from bracket_ground.files.row_store import RowStore

OF = {"command": "faults"}


def test_rows_are_there_again_and_a_row_that_was_cut_short_is_not(tmp_path: Path) -> None:
    path = tmp_path / "new" / "rows.jsonl"
    first = RowStore(path, ["seed"], OF)
    first.add({"seed": 1})
    first.add({"seed": 2})
    path.write_text(path.read_text()[:-4])
    second = RowStore(path, ["seed"], OF)
    assert second.rows == [{"seed": 1}]
    second.add({"seed": 2})
    assert RowStore(path, ["seed"], OF).rows == [{"seed": 1}, {"seed": 2}]


def test_a_heading_that_was_cut_short_is_written_again(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    RowStore(path, ["seed"], OF)
    whole = path.read_text()
    path.write_text(whole[:7])
    RowStore(path, ["seed"], OF)
    assert path.read_text() == whole


@pytest.mark.parametrize("of", [OF, None])
@pytest.mark.parametrize("text", ['{"rows_of": {"command": "other"}}\n', "a events\n", "a events", "[]\n", "1\n"])
def test_a_file_of_something_else_is_refused_and_left_as_it_is(
    tmp_path: Path, text: str, of: dict[str, str] | None
) -> None:
    path = tmp_path / "rows.jsonl"
    path.write_text(text)
    with pytest.raises(InputError, match=r"rows\.jsonl:1: .*name another file"):
        RowStore(path, ["seed"], of)
    assert path.read_text() == text


def test_a_refusal_names_what_differs_alone(tmp_path: Path) -> None:
    path, weights = tmp_path / "rows.jsonl", dict.fromkeys(map(str, range(99)), "0123456789abcdef")
    RowStore(path, ["seed"], {"command": "mine", "code": "a1", "weights": weights})
    with pytest.raises(InputError) as refused:
        RowStore(path, ["seed"], {"command": "mine", "code": "b2", "weights": {**weights, "0": "f"}})
    assert str(refused.value) == f"{path}:1: rows of code a1, not b2; other weights; name another file"


def test_a_row_is_kept_once_for_its_key(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    path.write_text('{"key": "a"}\n{"key": "b", "se')
    store = RowStore(path, ["key"])
    store.add({"key": "b", "seed": 1})
    store.add({"key": "b", "seed": 2})
    again = RowStore(path, ["key"])
    assert ("b" in again, "c" in again) == (True, False)
    assert again["b"] == {"key": "b", "seed": 1}
    assert [row["key"] for row in again.rows_of(["b", "a"])] == ["b", "a"]


def test_a_second_process_adds_no_rows_meanwhile(tmp_path: Path) -> None:
    path = tmp_path / "runs.jsonl"
    other = "import sys; from bracket_ground.files.row_store import RowStore; from pathlib import Path; "
    command = [sys.executable, "-c", f"{other}RowStore(Path(sys.argv[1]), ['key']).add({{'key': 'b'}})", str(path)]
    store = RowStore(path, ["key"])
    store.add({"key": "a"})
    refused = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert "another process adds rows to it" in refused.stderr
    del store
    subprocess.run(command, check=True, timeout=60)
    assert sorted(RowStore(path, ["key"]).keys) == ["a", "b"]


def test_a_key_of_several_fields_may_lack_some() -> None:
    store = RowStore(None, ["kind", "tree"])
    store.add({"kind": "assembly"})
    store.add({"kind": "throughput", "tree": "t"})
    assert list(store.keys) == [("assembly", None), ("throughput", "t")]
    assert store.rows == [{"kind": "assembly"}, {"kind": "throughput", "tree": "t"}]
    with pytest.raises(KeyError):
        store.add({"seed": 1})


def test_a_folder_is_no_file_of_rows(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "rows.jsonl" / "below"):
        (tmp_path / "rows.jsonl").touch()
        with pytest.raises(InputError, match=r"cannot keep rows: (Is a directory|what should be its folder is a file)"):
            RowStore(path, ["seed"], OF)
