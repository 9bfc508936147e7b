"""`cell lab schema`: what editors are told agrees with what the program reads."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml
from jsonschema import Draft202012Validator

from cell.commands.init import schema_texts
from cell.commands.main import main
from sim.scene.look_range import LookFile
from sim.scene.settings import SimSettings
from tests import ROOT

CONFIG = ROOT / "config"
FILES = [
    *(("cell", path) for path in (CONFIG / "cell.yaml", CONFIG / "paper.yaml")),
    *(("products", path) for path in CONFIG.glob("products*.yaml")),
    *(("faults", path) for path in CONFIG.glob("faults*.yaml")),
    *(("sim", path) for path in CONFIG.glob("sim*.yaml")),
    *(("robot", path) for path in (CONFIG / "robots").glob("*.yaml")),
    *(("look", path) for path in (CONFIG / "looks").glob("*.yaml")),
]


def errors(kind: str, data: object) -> list[str]:
    validator = Draft202012Validator(json.loads(schema_texts()[f"{kind}.json"]))
    return [error.message for error in validator.iter_errors(data)]


@pytest.mark.parametrize(("kind", "path"), FILES, ids=lambda value: getattr(value, "stem", value))
def test_shipped_files_fit_their_schema(kind: str, path: Path) -> None:
    assert errors(kind, yaml.safe_load(path.read_text())) == []


def test_every_kind_of_shipped_file_is_tried() -> None:
    assert {kind for kind, _ in FILES} == {"cell", "sim", "robot", "products", "faults", "look"}
    assert len(FILES) == len(list(CONFIG.rglob("*.yaml")))


@pytest.mark.parametrize(
    ("kind", "path", "old", "new"),
    [
        ("cell", "cell.yaml", "tick_hz: 25.0", "tick_hs: 25.0"),
        ("cell", "cell.yaml", "tick_hz: 25.0", "tick_hz: -1"),
        ("cell", "cell.yaml", "arm: {kind: simulated}", "arm: {kind: simulated, host: a}"),
        ("cell", "cell.yaml", "bitrate: 500000", "bitrate: fast"),
        ("robot", "robots/ur10.yaml", "speed_rad_s", "speed_rad"),
        ("products", "products.yaml", "quantity: 3", "quantity: many"),
        ("look", "looks/varied.yaml", "headlight: [0.0, 0.2]", "headlight: [0.0, 0.2, 0.3]"),
        ("look", "looks/varied.yaml", "headlight:", "hedlight:"),
    ],
)
def test_mistakes_are_marked(kind: str, path: str, old: str, new: str) -> None:
    text = (CONFIG / path).read_text()
    assert old in text
    assert errors(kind, yaml.safe_load(text.replace(old, new, 1)))


def test_a_look_may_stand_in_the_simulation_by_name_or_value() -> None:
    for look in ("hard", {"light": {"ambient": [0.25, 0.45]}}):
        assert errors("sim", {"look": look}) == []
    assert errors("sim", {"look": {"light": {"ambience": 1}}})


def test_a_driver_of_ones_own_may_have_any_settings() -> None:
    data = yaml.safe_load((CONFIG / "cell.yaml").read_text())
    data["devices"]["arm"] = {"kind": "lab:Arm", "host": "192.0.2.10"}
    assert errors("cell", data) == []


def test_models_of_a_look_have_names_of_their_own() -> None:
    """The schema of the simulation holds them beside its own."""
    configuration = SimSettings.model_json_schema()["$defs"].keys()
    assert not configuration & LookFile.model_json_schema()["$defs"].keys()


def test_keys_are_explained() -> None:
    properties = json.loads(schema_texts()["cell.json"])["$defs"]["ControllerSettings"]["properties"]
    assert properties["tick_hz"]["description"]


def test_schemas_are_renewed_and_nothing_else_is_replaced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "schema"
    assert main(["lab", "schema", str(folder)]) == 0
    assert f"# yaml-language-server: $schema={folder / 'cell.json'}" in capsys.readouterr().err
    assert {path.name for path in folder.iterdir()} == set(schema_texts())
    assert main(["lab", "schema", str(folder)]) == 0
    (folder / "look.json").write_text("mine")
    (folder / "cell.json").unlink()
    assert main(["lab", "schema", str(folder)]) == 2
    assert f"{folder / 'look.json'}: was not written by this program" in capsys.readouterr().err
    assert (folder / "look.json").read_text() == "mine"
    assert not (folder / "cell.json").exists()
