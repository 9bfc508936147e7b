"""`cell doctor`: what matters first, on standard output; only what a run needs makes a machine unfit."""

from __future__ import annotations

import json
import re
import shutil
from collections import namedtuple
from functools import cache
from pathlib import Path

import pytest

from bracket_cell.commands import doctor
from bracket_cell.commands.doctor import examine
from bracket_cell.commands.main import main
from bracket_cell.kinds import WEIGHTS
from bracket_cell.packages import missing_packages
from bracket_sim import simulator
from bracket_sim.rendering.available import renders
from tests import ROOT

Usage = namedtuple("Usage", "total used free")


RENDERS, PACKAGES = cache(renders), cache(missing_packages)


@pytest.fixture(autouse=True)
def short_trial(monkeypatch: pytest.MonkeyPatch) -> None:
    """It looks at the cell for a moment, at rendering and packages once, and not at the files of all packages."""
    monkeypatch.setattr(simulator, "renders", RENDERS)
    monkeypatch.setattr(doctor, "missing_packages", PACKAGES)
    monkeypatch.setattr(doctor, "damaged_packages", dict)
    monkeypatch.setattr(doctor, "TRIAL_S", 0.2)


def configuration(folder: Path, old: str = "", new: str = "") -> Path:
    """A copy of the shipped configuration with one change."""
    shutil.copytree(ROOT / "config", folder / "config", ignore=shutil.ignore_patterns("*.py", "__pycache__"))
    path = folder / "config" / "cell.yaml"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    return path


def test_what_matters_comes_first_and_packages_are_one_line(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    status = main(["doctor"])
    told = capsys.readouterr()
    assert (status, told.err) == (0, "")
    words = [
        "rendering",
        "GB free",
        "logs can be written",
        "CAN",
        "x real time",
        "cameras",
        "configuration",
        "packages",
    ]
    places = [told.out.index(word) for word in words]
    assert places == sorted(places)
    assert len(told.out.splitlines()) <= 20
    assert list(tmp_path.iterdir()) == [], "it only looks"


def test_json_is_one_line_and_all(capsys: pytest.CaptureFixture[str]) -> None:
    main(["doctor", "--json"])
    answer = json.loads(capsys.readouterr().out)
    assert answer["healthy"]
    assert all(set(finding) == {"what", "ok", "remedy", "needed"} for finding in answer["findings"])


def test_what_only_training_needs_is_a_note(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(doctor, "offers", lambda _: False)
    assert main(["doctor"]) == 0
    assert "note    training\n        install it: make train-deps" in capsys.readouterr().out


def test_a_full_disk_and_a_missing_package_are_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(10**12, 10**12, 4 * 10**8))
    monkeypatch.setattr(doctor, "missing_packages", lambda: (["mujoco", "ruckig"], ["ruckig"]))
    monkeypatch.setattr(doctor, "_devices", lambda *_: ())
    findings = {finding.what: finding for finding in examine(configuration(tmp_path))}
    assert not findings["0.4 GB free for logs"].ok
    (packages,) = [finding for what, finding in findings.items() if what.endswith("packages: ruckig")]
    assert (packages.ok, packages.needed) == (False, True)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("o2: [1.02, 0.14,", "o2: [1.02, 0.20,", "the bin of o2 and the bin of o1 overlap"),
        ("o3: [1.02, -0.08,", "o3: [0.80, -0.08,", "the bin of o3 and the bracket overlap"),
        ("o3: [1.02, -0.08,", "o3: [0.70, -0.38,", "the bin of o3 and the tray overlap"),
    ],
)
def test_bins_that_stand_in_each_others_place_are_told_with_their_line(
    old: str, new: str, words: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(doctor, "_devices", lambda *_: ())
    what = "bins, tray, bracket and obstacles do not overlap, and no hole is hidden"
    (sound,) = [finding for finding in examine(configuration(tmp_path / "sound")) if finding.what == what]
    assert (sound.ok, sound.remedy) == (True, "")
    path = configuration(tmp_path / "wrong", old, new)
    (finding,) = [finding for finding in examine(path) if finding.what == what]
    assert (finding.ok, finding.needed) == (False, False)
    line = next(number for number, text in enumerate(path.read_text().splitlines(), 1) if new in text)
    assert f"{path}:{line}:" in finding.remedy
    assert words in finding.remedy


def test_where_the_simulator_cannot_be_loaded_the_table_is_whole(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def unloaded(*_: object) -> None:
        raise RuntimeError("invalid value for environment variable MUJOCO_GL: nosuch")

    monkeypatch.setattr(simulator, "renders", lambda _: False)
    monkeypatch.setattr(simulator, "overlapping", unloaded)
    found = examine(configuration(tmp_path))
    assert found[0].what.startswith("rendering")
    assert [finding.what for finding in found if finding.needed and not finding.ok] == [found[0].what]
    assert any(finding.what.startswith("Python") for finding in found)


def test_without_rendering_no_device_is_opened(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(simulator, "renders", lambda _: False)
    first, *others = examine(configuration(tmp_path))
    assert (first.ok, first.needed) == (False, True)
    assert "apt-get install -y libegl1" in first.remedy
    assert not any("cameras" in finding.what for finding in others)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("interface: virtual", "interface: socketcan", "ip link set gripper up type can"),
        ("panel: {kind: simulated}", "panel: {kind: our_bench:Lamp}", "no module 'our_bench'"),
        ("tick_hz: 25.0", "tick_hz: -1", "controller.tick_hz: input should be"),
        ("[0.72, 0.14, 0.036]", "[0.72, 0.14, 0.001]", "the upper side is 0.001 m above the table"),
    ],
)
def test_a_configuration_that_does_not_fit_the_machine_is_told(old: str, new: str, words: str, tmp_path: Path) -> None:
    bad = [finding for finding in examine(configuration(tmp_path, old, new)) if finding.needed and not finding.ok]
    assert [words in finding.remedy for finding in bad] == [True]


@pytest.mark.parametrize("there", ["", "holes_plate.onnx parts_centre.onnx", "*[!d]er.onnx *[!r].onnx"])
def test_weights_of_detectors_that_are_missing_make_the_machine_unfit(
    there: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """Not even the finder's alone may be missing, which stands beside those that the configuration names."""
    monkeypatch.setattr(doctor, "_devices", lambda *_: ())
    path = configuration(tmp_path, "  kind: learned", "  folder: ../t2\n  kind: learned")
    for pattern in there.split():
        (tmp_path / "t2").mkdir(exist_ok=True)
        for file in WEIGHTS.glob(pattern):
            shutil.copy(file, tmp_path / "t2")
    assert main(["doctor", "--config", str(path)]) == 1
    told = capsys.readouterr().out
    assert "MISSING detectors learned\n" in told
    assert "hands_slim" in told
    assert "cannot read the weights" in told
    assert "cell train --all" in told


def test_what_a_product_of_ones_own_is_seen_by_is_a_note(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(doctor, "_devices", lambda *_: ())
    path = configuration(tmp_path)
    for file in (path, path.with_name("products.yaml")):
        file.write_text(re.sub(r"\bo1\b", "ball", file.read_text()))
    (finding,) = [one for one in examine(path) if one.what.startswith("detectors")]
    assert (finding.ok, finding.needed) == (False, False)
    assert "classical (colours, outlines): actions, holes, parts: " in finding.remedy
