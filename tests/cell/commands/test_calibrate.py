"""`cell setup calibrate` writes a file that a configuration can name, and nothing over a user's."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from bracket_cell.commands.main import main
from bracket_cell.commands.options import CONFIGURATION, told_in
from bracket_cell.configuration import DEFAULT_CONFIGURATION, load_configuration, unnamed_calibration
from bracket_ground.errors import InputError
from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.bench import Calibration, CameraCalibration

BENCH = load_configuration().bench


@pytest.mark.long
def test_the_file_is_taken_over_by_the_configuration_that_names_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    look = tmp_path / "pushed.yaml"
    look.write_text("mounts: {overhead: {shift_m: 0.01}}\n")
    out = tmp_path / "calibration.yaml"
    command = ["setup", "calibrate", "--overhead-only", "--look", str(look), "--out", str(out), "--json"]
    assert main(command) == 0
    said = capsys.readouterr()
    assert "".join(said.err.split()).endswith(f"calibration:{told_in(CONFIGURATION, out)}")
    told = json.loads(said.out.splitlines()[-1])
    assert told["good"]
    assert 8 < told["overhead"]["off_mm"] < 12
    assert main(command) == 2
    assert "exists already" in capsys.readouterr().err
    text = DEFAULT_CONFIGURATION.read_text("utf-8").replace("product: products.yaml", f"product: {PRODUCTS}")
    text = text.replace("simulation: sim.yaml", f"simulation: {PRODUCTS.with_name('sim.yaml')}")
    own = tmp_path / "cell.yaml"
    own.write_text(text + "\ncalibration: calibration.yaml\n")
    bench = load_configuration(own).bench
    assert bench.overhead.mount != BENCH.overhead.mount
    assert bench.drawn.overhead.mount == BENCH.overhead.mount
    assert bench.wrist == BENCH.wrist


@pytest.mark.long
def test_the_overhead_camera_alone_leaves_the_wrist_camera_in_the_file(tmp_path: Path) -> None:
    out = tmp_path / "calibration.yaml"
    mount = BENCH.wrist.mount
    wrist = CameraCalibration(mount=mount, focal_px=BENCH.wrist.focal_px, rms_px=0.4)
    out.write_text(yaml.safe_dump({"wrist": wrist.model_dump(mode="json", exclude_none=True)}))
    assert main(["setup", "calibrate", "--overhead-only", "--overwrite", "--look", "nominal", "--out", str(out)]) == 0
    found = load_yaml(out, Calibration)
    assert found.overhead is not None
    assert found.wrist == wrist


def test_a_file_that_cannot_be_written_is_told_before_anything_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    assert main(["setup", "calibrate", "--out", str(tmp_path / "file" / "calibration.yaml")]) == 2
    said = capsys.readouterr().err
    assert "cannot be written" in said
    assert "keep away" not in said


def test_a_calibration_that_is_not_there_is_told(tmp_path: Path) -> None:
    text = DEFAULT_CONFIGURATION.read_text("utf-8").replace("product: products.yaml", f"product: {PRODUCTS}")
    text = text.replace("simulation: sim.yaml", f"simulation: {PRODUCTS.with_name('sim.yaml')}")
    own = tmp_path / "cell.yaml"
    own.write_text(text + "\ncalibration: nowhere.yaml\n")
    with pytest.raises(InputError, match=r"nowhere\.yaml"):
        load_configuration(own)


PRODUCTS = DEFAULT_CONFIGURATION.with_name("products.yaml")


def test_a_calibration_that_lies_beside_and_is_not_named_is_said(tmp_path: Path) -> None:
    config, file = tmp_path / "cell.yaml", tmp_path / "calibration.yaml"
    configuration = load_configuration()
    assert unnamed_calibration(config, configuration) == ""
    file.write_text("")
    said = unnamed_calibration(config, configuration)
    assert said == f"{file} is not used: {config} does not name it; to use it, add there: calibration: calibration.yaml"
    assert unnamed_calibration(config, configuration.model_copy(update={"calibration": file})) == ""
