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
from bracket_cell.wiring import contracted
from bracket_ground.contracts.arm import check_no_call_waits, check_standing
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
    assert len(told["findings"]) == 7
    assert [what for what in wrong if "A stop ends on the path" in what] == wrong
    assert len(wrong) == status


STATE = "def state(self): return self._arm.state()"
FOLLOW = "def follow(self, trajectory): return self._arm.follow(trajectory)"
TOLD = "def state(self): s = self._arm.state(); return __import__('dataclasses').replace(s, {})"
FAULTS = {
    "late": (STATE, "def state(self): __import__('time').sleep(0.06); return self._arm.state()", "ms, must come back"),
    "late to follow": (FOLLOW, 'def follow(self, way): __import__("time").sleep(.06); return way', "ms, must come"),
    "too few joints": (STATE, TOLD.format("positions_rad=s.positions_rad[:5]"), "tells 5 joints, the robot has 6"),
    "no numbers": (STATE, TOLD.format("positions_rad=(float('nan'),) * 6"), "tells no number of each joint: (nan, nan"),
    "tells nothing": (STATE, "def state(self): pass", "state gives None, must give an ArmState"),
    "follows nothing": (FOLLOW, "def follow(self, _): pass", "follow gives None, must give the path"),
    "raises": (STATE, "def state(self): raise KeyError('boom')", "raises KeyError 'boom' at "),
    "leaves": (FOLLOW, "def follow(self, _): raise SystemExit(3)", "raises SystemExit 3 at "),
    "does not open": ("self._arm = simulated", "raise ZeroDivisionError", "ZeroDivisionError"),
    "does not close": ("def close(self): pass", "def close(self): raise ValueError('open')", "raises ValueError open"),
    "hangs": (STATE, "def state(self): import threading; threading.Event().wait()", "does not come back within 8 s"),
    "stays open": ("def close(self): pass", "def close(self): __import__('threading').Event().wait()", "within 8 s"),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_what_breaks_a_rule_is_told_and_never_waited_for(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    good, bad, words = FAULTS[name]
    assert DRIVER.count(good) == 1
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "own_arm", raising=False)
    monkeypatch.setattr(contracted, "CHECKS", {**contracted.CHECKS, "arm": (check_standing, check_no_call_waits)})
    monkeypatch.setattr(contracted, "MOST_S", 8.0 if "within 8 s" in words else 90.0)
    assert main(["doctor", "--config", cell(tmp_path, DRIVER.replace(good, bad)), "--contract", "arm"]) in (1, 3)
    told = capsys.readouterr()
    assert words in " ".join((told.out + told.err).split())
    assert "Traceback" not in told.out + told.err
    assert "WARNING" not in told.out + told.err


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
