"""`cell check --config` tells of obstacles that stand where they cannot, and a run does not begin in one."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bracket_cell.commands.main import main
from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.wiring.bench_checks import refuse_blocked
from bracket_ground.errors import SettingError
from tests import ROOT
from tests.cell.interfaces.test_obstacles import bench_with

TREE = str(ROOT / "trees" / "ahead.xml")


@pytest.mark.parametrize(
    ("obstacle", "words"),
    [
        (
            "{name: lamp, position_m: [0.56, -0.38, 0.1], box_m: [0.1, 0.1, 0.2]}",
            "warning: lamp and the tray overlap by",
        ),
        (
            "{name: lamp, position_m: [1.02, 0.34, 0.1], cylinder_m: [0.1, 0.2]}",
            "warning: lamp and the bin of o1 overlap",
        ),
        ("{name: lamp, position_m: [0.74, 0.05, 0.8], box_m: [0.3, 0.3, 0.1]}", "between the overhead camera and p"),
    ],
)
def test_what_is_doubtful_is_told_with_its_line(
    obstacle: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bench_with(tmp_path, obstacle)
    assert main(["check", TREE, "--config", str(path)]) == 1
    told = capsys.readouterr().err
    assert words in told
    line = 1 + path.read_text().splitlines().index("  obstacles:")
    assert f"{path}:{line}" in told or f"{path}:{line + 1}" in told


def test_a_hole_that_nobody_sees_or_reaches_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = bench_with(tmp_path, "{name: lamp, position_m: [0.2, 0.6, 0.1], box_m: [0.1, 0.1, 0.2]}")
    product = (ROOT / "config" / "products.yaml").read_text()
    (tmp_path / "wide.yaml").write_text(re.sub(r"p6: \[[^]]*\]", "p6: [2.0, 0.0]", product, count=1))
    path.write_text(re.sub(r"product: .*", "product: wide.yaml", path.read_text()))
    main(["check", TREE, "--config", str(path)])
    told = capsys.readouterr().err
    assert "the image of the overhead camera ends before p6: nobody sees what is in there" in told
    assert "the arm cannot put o1, o2, o3 into p6: the person places it" in told
    assert "into p5" not in told
    path.write_text(path.read_text().replace("position_m: [0.72, 0.14, 0.036]", "position_m: [2.2, 0.14, 0.036]"))
    main(["check", TREE, "--config", str(path)])
    told = capsys.readouterr().err
    assert "ends before p1, p2, p3, p4, p5, p6: nobody sees what is in there" in told
    assert told.count("the arm cannot put") == 2, "holes that are beyond the arm for the same parts are told together"


def test_an_arm_that_rests_in_something_is_a_mistake(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = bench_with(tmp_path, "{name: lamp, position_m: [0.45, -0.50, 0.45], box_m: [0.1, 0.1, 0.3]}")
    assert main(["check", TREE, "--config", str(path)]) == 2
    told = capsys.readouterr().err
    assert f"{path}:" in told
    assert "the arm rests in something" in told
    assert "arm_park_rad left out, another is found" in told
    assert "would touch lamp" in told
    configuration = load_configuration(path)
    with pytest.raises(SettingError, match="arm_park_rad"):
        refuse_blocked(MotionPlanner(load_product(configuration, path), configuration.bench, configuration.motion))


def test_a_pose_of_another_arm_that_shows_no_tray_is_a_mistake(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = bench_with(tmp_path, "{name: lamp, position_m: [0.2, 0.6, 0.1], box_m: [0.1, 0.1, 0.2]}")
    path.write_text(path.read_text().replace("arm_look_rad: [-0.7485,", "arm_look_rad: [0.9,"))
    assert main(["check", TREE, "--config", str(path)]) == 2
    assert "from arm_look_rad the wrist camera sees nothing of the tray; left out, another" in capsys.readouterr().err


TENDING = ROOT / "config" / "examples" / "tending"


def tending(folder: Path, change: tuple[str, str]) -> Path:
    """The example of machine tending with a change."""
    text = (TENDING / "cell.yaml").read_text().replace("../../products.yaml", str(ROOT / "config" / "products.yaml"))
    path = folder / "cell.yaml"
    path.write_text(text.replace(*change))
    (folder / "sim.yaml").write_bytes((TENDING / "sim.yaml").read_bytes())
    return path


@pytest.mark.long
def test_the_example_trees_fit_their_bench() -> None:
    trees = [str(TENDING / name) for name in ("tend.xml", "sort.xml")]
    assert main(["check", *trees, "--config", str(TENDING / "cell.yaml"), "--strict"]) == 0


@pytest.mark.long
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("[0.55, 0.62, 0.080]", "[1.05, 0.90, 0.080]"), "bring o1 to spot 0 and fetch it again: cannot put o1 there"),
        (("enter_from_m: [0.0, -0.18, 0.0]", "enter_from_m: [0.18, 0.0, 0.0]"), "would touch the machine's side wall"),
    ],
)
def test_a_place_that_can_never_be_reached_is_a_mistake(
    change: tuple[str, str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tending(tmp_path, change)
    assert main(["check", str(TENDING / "tend.xml"), "--config", str(path)]) == 2
    told = capsys.readouterr().err
    line = 1 + next(n for n, text in enumerate(path.read_text().splitlines()) if text.strip().startswith("chuck:"))
    assert f"{path}:{line}" in told
    assert words in told
    configuration = load_configuration(path)
    with pytest.raises(SettingError, match=r"bench\.places\.chuck"):
        refuse_blocked(MotionPlanner(load_product(configuration, path), configuration.bench, configuration.motion))


@pytest.mark.long
@pytest.mark.parametrize(
    ("node", "words"),
    [
        ('<PutDown part="o1" spot="world: 0.75 -0.10 0"/>', "PutDown: it is at the bracket"),
        ('<PutDown part="{part}" spot="world: 1.9 0.9 0"/>', "PutDown: cannot put o3 there: out of the arm's reach"),
        ('<MoveToPose pose="fixture: 0 2 0.2"/>', "MoveToPose: out of the arm's reach"),
        ('<MoveStraight pose="world: 0.3 0.42 -0.2"/>', "MoveStraight:"),
        ('<Place part="o1" at="pallet" spot="9"/>', "Place: pallet has 4 spots, from 0"),
        ('<Pick from="pallet" type="o3"/>', "Pick: pallet holds o1, o2"),
    ],
)
def test_a_constant_spot_that_can_never_work_is_a_mistake(
    node: str, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tree = tmp_path / "tree.xml"
    script = """<Script code="part := 'o1'"/>"""
    tree.write_text(
        '<root BTCPP_format="4" main_tree_to_execute="M">\n'
        f'<BehaviorTree ID="M"><Sequence>{script}<Pick from="fixture"/>\n{node}\n</Sequence></BehaviorTree></root>'
    )
    assert main(["check", str(tree), "--config", str(TENDING / "cell.yaml")]) == 2
    told = capsys.readouterr().err
    assert f"{tree}:3:" in told
    assert words in told


def test_spots_that_can_be_reached_are_none(tmp_path: Path) -> None:
    tree = tmp_path / "tree.xml"
    nodes = '<PutDown part="o1" spot="pallet: 0.06 0.05 0"/><MoveToPose pose="fixture: 0 0 0.2"/>'
    tree.write_text(
        '<root BTCPP_format="4" main_tree_to_execute="M"><BehaviorTree ID="M"><Sequence>'
        f'<Pick from="fixture"/>{nodes}</Sequence></BehaviorTree></root>'
    )
    assert main(["check", str(tree), "--config", str(TENDING / "cell.yaml")]) in (0, 1)
