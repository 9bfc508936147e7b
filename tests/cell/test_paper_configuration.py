"""config/paper.yaml: the shipped cell with the paper's detectors and planners, and nothing else changed."""

from __future__ import annotations

from pathlib import Path

import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.wiring.detectors import check_detectors
from bracket_cell.wiring.services import load_planners
from bracket_ground.errors import InputError, SettingError
from bracket_ground.files.files import shipped
from bracket_lab.learned.grasp.paper_planner import PaperPlanner as GraspPlanner
from bracket_lab.learned.semantic.paper_planner import PaperPlanner as SemanticPlanner

PAPER = shipped("bracket_cell.config", "paper.yaml")
CONFIGURATION, OURS = load_configuration(PAPER), load_configuration()


def test_it_is_the_shipped_cell_but_for_perception_planners_and_what_mistakes_cost() -> None:
    same = {"perception": OURS.perception, "planners": OURS.planners, "guard": OURS.guard}
    assert CONFIGURATION.model_copy(update=same) == OURS
    assert CONFIGURATION.perception.words == "learned, hands mediapipe, actions paper, parts rcnn"


def test_its_planners_are_the_papers() -> None:
    made = load_planners(CONFIGURATION, load_product(CONFIGURATION))
    assert isinstance(made.semantic, SemanticPlanner)
    assert isinstance(made.grasp, GraspPlanner)


def test_all_that_it_lacks_is_mediapipe_and_one_command_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    with pytest.raises(SettingError) as told:
        check_detectors(CONFIGURATION.bench, load_product(CONFIGURATION), CONFIGURATION.perception)
    ((place, words),) = told.value.places
    assert place == ("perception", "hands")
    assert "cell lab hands" in words


def test_a_cell_that_reads_no_holes_must_trust_its_graph(tmp_path: Path) -> None:
    text = PAPER.read_text().replace("  hands: {kind", "  holes: {kind: none}\n  hands: {kind")
    text = text.replace("robot: ur10 #", "robot: ur10 #").replace(
        "product: products.yaml", f"product: {PAPER.parent}/products.yaml"
    )
    text = text.replace("simulation: sim.yaml", f"simulation: {PAPER.parent}/sim.yaml")
    path = tmp_path / "cell.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=r"guard\.holes: graph"):
        load_configuration(path)
    path.write_text(text.replace("  wrong_act_s: 80.0", "  holes: graph\n  wrong_act_s: 80.0"))
    assert load_configuration(path).by_hand() == load_configuration(path)
    assert CONFIGURATION.by_hand().perception.chosen("holes").kind == "none"
