"""What docs/product.md and docs/bench.md tell their readers to do works, step by step as printed."""

from __future__ import annotations

import re
from inspect import isfunction
from itertools import takewhile
from pathlib import Path

import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.runs.bench_view import BenchView
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.wiring.services import load_planners
from bracket_ground.interfaces.clock import Clock
from bracket_ground.interfaces.devices import Arm, Camera, Gripper, Panel
from tests import ROOT
from tests.docs.guide import Reader, Step, steps

GUIDES = {"product.md": 1, "bench.md": 1}  # how often each runs the cell


def quick_steps(page: str) -> list[Step]:
    """All steps before anything is trained, without those that take long."""
    return [step for step in takewhile(lambda step: "cell train" not in step.text, steps(page)) if not step.long]


@pytest.fixture(scope="module", params=GUIDES)
def done(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path, dict[str, str]]:
    """A page, the folder that its quick steps leave, and what its commands printed."""
    page = str(request.param)
    reader, printed = Reader(tmp_path_factory.mktemp("guide")), {}
    for step in quick_steps(page):
        reader.do(step)
        if step.kind == "console":
            printed[step.text] = reader.printed
    return page, reader.folder, printed


@pytest.mark.long
def test_the_files_that_a_guide_makes_fit_together(done: tuple[str, Path, dict[str, str]]) -> None:
    path = done[1] / "config" / "cell.yaml"
    configuration = load_configuration(path)
    product = load_product(configuration, path)
    load_planners(configuration, product)


@pytest.mark.parametrize("done", ["bench.md"], indirect=True)
def test_the_look_pose_that_the_guide_leaves_out_shows_the_whole_tray(done: tuple[str, Path, dict[str, str]]) -> None:
    path = done[1] / "config" / "cell.yaml"
    cell = load_configuration(path)
    motion = MotionPlanner(load_product(cell, path), cell.bench, cell.motion)
    assert "the wrist camera sees the whole tray" in BenchView(cell.bench, motion.product, motion).remarks


@pytest.mark.parametrize("protocol", [Arm, Camera, Gripper, Panel, Clock], ids=lambda protocol: protocol.__name__)
def test_the_guide_names_all_functions_that_a_driver_needs(protocol: type) -> None:
    row = re.search(rf"^\| `{protocol.__name__}` \|(.*)\|$", (ROOT / "docs" / "drivers.md").read_text(), re.MULTILINE)
    assert row is not None
    functions = {name for name, value in vars(protocol).items() if isfunction(value) and not name.startswith("_")}
    assert functions <= set(re.findall(r"`(\w+)`", row[1]))


@pytest.mark.slow
@pytest.mark.parametrize("page", GUIDES)
def test_a_guide_typed_as_printed_assembles_its_product(page: str, tmp_path: Path) -> None:
    reader = Reader(tmp_path)
    for step in steps(page):
        reader.do(step)
    assert len(list((reader.folder / "runs").glob("*.mcap"))) == GUIDES[page]
