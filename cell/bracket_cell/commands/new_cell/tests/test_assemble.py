"""The cell's tree and configuration, tested without the cell: run `pytest` in the folder above."""

from pathlib import Path

from bracket_cell import load_cell
from bracket_cell.trees import Bench
from bracket_cell.trees.node_library import node_registry
from btxml.files.check import check

FOLDER = Path(__file__).resolve().parents[1]
TREE = FOLDER / "trees" / "assemble.xml"


def test_trees_have_no_mistakes() -> None:
    own = [str(folder) for folder in [FOLDER / "nodes"] if folder.is_dir()]
    assert check(sorted(TREE.parent.glob("*.xml")), node_registry(more=own)) == []


def test_configuration_fits_the_product() -> None:
    assert load_cell(FOLDER / "config" / "cell.yaml").product.goals


def test_nothing_moves_while_the_gripper_is_not_active() -> None:
    # S: success, F: failure, R: running, one letter a tick
    bench = Bench(TREE, {"ActivateGripper": "RRF"})
    assert [bench.tick(), bench.tick(), bench.tick()] == ["R", "R", "F"]
    assert bench.started("MoveTo") == 0
