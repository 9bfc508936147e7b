"""Values are put into YAML files that people edit."""

from functools import partial
from pathlib import Path

import pytest
import yaml

from bracket_ground.errors import InputError
from bracket_ground.files.model import Model
from bracket_ground.files.yaml_file import load_yaml, write_values


def test_values_are_put_in_and_all_else_stays(tmp_path: Path) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text(
        "# a cell\nbench: # measured\n  park: [1, 2] # near the tray\n\n  tray:\n    - 1\n    - 2\n  # the end\n"
        "devices:\n  arm: {kind: simulated} # for now\n"
    )
    write_values(path, {("bench", "park"): [0.5, -1.0], ("bench", "tray"): [3], ("devices", "arm", "host"): "a"})
    write_values(path, {("bench", "look"): [1.5]})
    assert path.read_text() == (
        "# a cell\nbench: # measured\n  look: [1.5]\n  park: [0.5, -1.0] # near the tray\n\n  tray:\n    [3]\n"
        "  # the end\ndevices:\n  arm: {kind: simulated, host: a} # for now\n"
    )
    with pytest.raises(InputError, match="key 'panel' is missing"):
        write_values(path, {("devices", "panel", "kind"): "none"})


def test_a_list_whose_dashes_stand_under_its_key_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "cell.yaml"
    path.write_text("bench:\n  obstacles:\n  - {name: a}\n  - {name: b} # old\n  tray: 1 # kept\nmore:\n- 1\n- 2\n")
    write_values(path, {("bench", "obstacles"): [{"name": "c"}], ("more",): [3]})
    assert yaml.safe_load(path.read_text()) == {"bench": {"obstacles": [{"name": "c"}], "tray": 1}, "more": [3]}
    assert "# kept" in path.read_text()


def test_what_would_not_be_legal_is_not_written(tmp_path: Path) -> None:
    path = tmp_path / "grip.yaml"
    path.write_text("width_px: 480\nheight_px: 360\n")
    before = path.read_bytes()

    class Size(Model):
        width_px: int
        height_px: int

    with pytest.raises(InputError, match=r"grip.yaml stays as it was: .* not legal: width_px: .* not 'wide'"):
        write_values(path, {("width_px",): "wide"}, partial(load_yaml, model=Size))
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["grip.yaml"]
