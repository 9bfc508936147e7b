"""`cell lab files`: what a run was made with comes out of its log, and nothing of the user's is touched."""

from __future__ import annotations

from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from bracket_cell.log.read.reader import LogStream
from bracket_ground.errors import LogError
from bracket_lab.commands.logs import check_name
from bracket_sim.scene.look import Look
from bracket_sim.scene.look_range import look_range
from tests import ROOT

LOG = ROOT / "tests" / "cases" / "assembly-g0-seed5.mcap"


def test_the_files_of_a_run_come_out_of_its_log(tmp_path: Path) -> None:
    assert main(["lab", "files", str(LOG), "--out", str(tmp_path / "files")]) == 0
    stream = LogStream(LOG)
    next(iter(stream))
    assert {"configuration.yaml", "product.yaml"} <= set(stream.attachments)
    for name, content in stream.attachments.items():
        assert (tmp_path / "files" / name).read_bytes() == content


def test_the_look_that_was_drawn_is_a_look_file_without_ranges(tmp_path: Path) -> None:
    assert main(["lab", "files", str(LOG), "--out", str(tmp_path)]) == 0
    looks = look_range(str(tmp_path / "look.yaml"))
    assert isinstance(looks.draw(1), Look)
    assert looks.draw(1) == looks.draw(2)


def test_what_is_there_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "product.yaml").write_text("mine")
    assert main(["lab", "files", str(LOG), "--out", str(tmp_path)]) == 2
    assert "product.yaml: exists already" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["product.yaml"]


@pytest.mark.parametrize("name", ["../a.yaml", "/etc/passwd", "a/../../b", "", "a\\b", "a\x00b", "a\x1b[2J"])
def test_no_file_lies_outside_the_folder(name: str) -> None:
    with pytest.raises(LogError, match="outside"):
        check_name(LOG, name)
