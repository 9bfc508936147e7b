"""`cell schema`: what editors are told agrees with what the program reads."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml
from jsonschema import Draft202012Validator
from lxml import etree

from bracket_cell.commands.main import main
from bracket_cell.commands.schema import schema_texts
from bracket_cell.trees.node_library import node_registry
from bracket_sim.scene.look_range import LookFile
from bracket_sim.scene.settings import SimSettings
from tests import ROOT

CONFIG = ROOT / "config"
FILES = [
    *(("cell", path) for path in (CONFIG / "cell.yaml", CONFIG / "paper.yaml", CONFIG / "twin_cell.yaml")),
    *(("products", path) for path in CONFIG.glob("products*.yaml")),
    *(("cell", path) for path in (CONFIG / "examples").glob("*/cell.yaml")),
    *(("products", path) for name in ("product", "flange") for path in (CONFIG / "examples").glob(f"*/{name}.yaml")),
    *(("faults", path) for path in CONFIG.glob("faults*.yaml")),
    *(("sim", path) for path in (*CONFIG.glob("sim*.yaml"), *CONFIG.glob("examples/*/sim.yaml"))),
    *(("robot", path) for path in (CONFIG / "robots").glob("*.yaml")),
    *(("gripper", path) for path in (CONFIG / "grippers").glob("*.yaml")),
    *(("look", path) for path in (CONFIG / "looks").glob("*.yaml")),
    *(("person", path) for path in (CONFIG / "people").glob("*.yaml")),
]
TEXTS = schema_texts(node_registry())


def errors(kind: str, data: object) -> list[str]:
    validator = Draft202012Validator(json.loads(TEXTS[f"{kind}.json"]))
    return [error.message for error in validator.iter_errors(data)]


@pytest.mark.parametrize(("kind", "path"), FILES, ids=str)
def test_shipped_files_fit_their_schema(kind: str, path: Path) -> None:
    assert errors(kind, yaml.safe_load(path.read_text())) == []


def test_every_kind_of_shipped_file_is_tried() -> None:
    assert {kind for kind, _ in FILES} == {"cell", "sim", "robot", "gripper", "products", "faults", "look", "person"}
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
    properties = json.loads(TEXTS["cell.json"])["$defs"]["ControllerSettings"]["properties"]
    assert properties["tick_hz"]["description"]


def test_schemas_are_renewed_and_nothing_else_is_replaced(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "schema"
    assert main(["schema", str(folder)]) == 0
    assert f"# yaml-language-server: $schema={folder / 'cell.json'}" in capsys.readouterr().err
    assert {path.name for path in folder.iterdir()} == set(TEXTS)
    assert main(["schema", str(folder)]) == 0
    (folder / "look.json").write_text("mine")
    (folder / "cell.json").unlink()
    assert main(["schema", str(folder)]) == 2
    assert f"{folder / 'look.json'}: was not written by this program" in capsys.readouterr().err
    assert (folder / "look.json").read_text() == "mine"
    assert not (folder / "cell.json").exists()


TREES = sorted((ROOT / "trees").rglob("*.xml"))
NODE = '''from btxml import InputPort, Node


class Greet(Node):
    """Say hello."""

    who = InputPort(str, "who is greeted")
'''


def tree_mistakes(content: str, xsd: str = TEXTS["trees.xsd"]) -> list[int]:
    """Lines at which a validator marks something in a tree file, of which `content` is one tree."""
    whole = (
        content
        if "<root" in content
        else f'<root BTCPP_format="4"><BehaviorTree ID="M">{content}</BehaviorTree></root>'
    )
    schema = etree.XMLSchema(etree.fromstring(xsd.encode()))
    schema.validate(etree.fromstring(whole.encode()))
    return [error.line for error in schema.error_log]


@pytest.mark.parametrize("path", TREES, ids=lambda path: path.stem)
def test_shipped_trees_fit_the_schema(path: Path) -> None:
    assert tree_mistakes(path.read_text().partition("?>")[2] or path.read_text()) == []


def test_trees_are_tried() -> None:
    assert len(TREES) >= 8


@pytest.mark.parametrize(
    "content",
    [
        '<MoveTu pose="park"/>',
        "<MoveTo/>",
        '<MoveTo pose="parc"/>',
        '<MoveTo pose="park" pase="look"/>',
        '<Repeat num_cycles="two"><Beep/></Repeat>',
        '<Repeat num_cycles="2"><Beep/><Beep/></Repeat>',
        '<Timeout msec="1.5"><Beep/></Timeout>',
        '<PickPart parts="o1" index="0"/>',
        '<SetSignal signal="lamp" value="yes"/>',
        "<SubTree/>",
        "<Sequence/>",
        '<Beep _skipif="true"/>',
    ],
)
def test_mistakes_in_trees_are_marked(content: str) -> None:
    assert tree_mistakes(content)


@pytest.mark.parametrize(
    "content",
    [
        '<MoveTo pose="{where}" name="there" _skipIf="n &gt; 3"/>',
        '<Repeat num_cycles="{n}"><Beep/></Repeat>',
        '<PickPart parts="{parts}" index="0"/>',
        '<SubTree ID="Any" part="o1" _autoremap="true"/>',
        '<SaveBlackboard file="a.json" count="{count}"/>',
        '<Action ID="MoveTo" pose="park"/>',
        '<Control ID="Sequence"><Beep/></Control>',
        '<SetSignal signal="lamp" value="true"/>',
    ],
)
def test_what_is_legal_in_trees_is_not_marked(content: str) -> None:
    assert tree_mistakes(content) == []


def test_the_schema_has_nodes_of_ones_own_and_names_of_the_configuration(tmp_path: Path) -> None:
    (tmp_path / "greet.py").write_text(NODE)
    config = str(CONFIG / "cell.yaml")
    assert main(["schema", str(tmp_path / "out"), "--with", str(tmp_path / "greet.py"), "--config", config]) == 0
    xsd = (tmp_path / "out" / "trees.xsd").read_text()
    assert tree_mistakes('<Greet who="you"/>', xsd) == []
    assert tree_mistakes("<Greet/>", xsd)
    part = etree.fromstring(xsd.encode()).xpath("//*[@name='PlacePart']//*[@name='part']//*[@value='o1']")
    assert len(part) == 1
