"""`cell doctor --contract`: the contract suite on anybody's device, with words and an exit status."""

from __future__ import annotations

import io
import json
import re
import sys
from pathlib import Path
from shutil import copytree

import pytest

from bracket_cell.commands.main import main
from tests import ROOT

DRIVER = '''
"""A user's own."""
from bracket_cell import Arm, ArmState, JointTrajectory


class Acme:
    """In front of the simulated arm."""

    def __init__(self, simulated: Arm) -> None:
        self._arm = simulated

    def __getattr__(self, name):
        return getattr(self._arm, name)

    def state(self): return self._arm.state()
    def follow(self, trajectory): return self._arm.follow(trajectory)
    def pace(self, share): self._arm.pace(share)
    def acknowledge(self): self._arm.acknowledge()
    def samples(self): return self._arm.samples()
    def close(self): pass
    def stop(self): self._arm.stop()
'''
DEAF = DRIVER.replace("def stop(self): self._arm.stop()", "def stop(self): pass")


def cell(folder: Path, driver: str) -> str:
    copytree(ROOT / "config", folder / "config", dirs_exist_ok=True)
    (folder / "config" / "own_arm.py").write_text(driver)
    path = folder / "config" / "cell.yaml"
    text = path.read_text()
    assert "  arm: {kind: simulated}" in text
    path.write_text(text.replace("  arm: {kind: simulated}", "  arm: {kind: own_arm:Acme}"))
    return str(path)


@pytest.mark.long
@pytest.mark.parametrize(("driver", "status"), [(DRIVER, 0), (DEAF, 1)], ids=["sound", "that never stops"])
def test_an_own_arm_is_tried_in_words(
    driver: str, status: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "own_arm", raising=False)
    assert main(["doctor", "--config", cell(tmp_path, driver), "--contract", "own_arm:Acme", "--json"]) == status
    told = json.loads(capsys.readouterr().out)
    assert told["healthy"] is (status == 0)
    wrong = [one["what"] for one in told["findings"] if not one["ok"]]
    assert len(told["findings"]) == 6
    assert [what for what in wrong if "A stop ends on the path" in what] == wrong
    assert len(wrong) == status


def test_nobody_there_to_press_enter_moves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO(""))
    path = Path(cell(tmp_path, DRIVER))
    text = path.read_text()
    other = "  gripper: {kind: robotiq_urcap, host: 192.0.2.1}\n"
    path.write_text(re.sub(r"^  gripper:.*\n(    .*\n)*", other, text, flags=re.MULTILINE))
    assert main(["doctor", "--config", str(path), "--contract", "gripper"]) == 2
    assert "nobody pressed Enter" in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.parametrize("role", ["gripper", "overhead"])
def test_a_simulated_device_needs_nobody(role: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--contract", role]) == 0
    assert capsys.readouterr().out.count("ok ") >= 4


def test_a_kind_that_nobody_has_is_said(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--contract", "acme:Arm"]) == 2
    assert "no device has the kind 'acme:Arm'; legal: arm, gripper, overhead, wrist" in capsys.readouterr().err
