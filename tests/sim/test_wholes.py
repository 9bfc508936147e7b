"""Sub-assemblies in the physics: joined where they stand as they should, carried as one, taken apart again."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from bracket_cell.commands.main import main
from bracket_cell.configuration import load_configuration, load_product
from bracket_ground.interfaces.pose import Pose
from bracket_sim.scene.clutter import full_set
from bracket_sim.scene.wholes import Joining
from bracket_sim.scene.world import World, WorldPart, build_world
from tests import ROOT

PATH = ROOT / "config" / "examples" / "subassembly" / "cell.yaml"
PERIOD_S = 0.04


def stacked(off_m: float = 0.0, path: Path = PATH, *more: str) -> tuple[World, WorldPart, WorldPart]:
    """A body in the nest with a cap on it, and with more on that."""
    configuration = load_configuration(path)
    product = load_product(configuration, path)
    world = build_world(product, configuration.bench)
    body, cap, *others = (
        next(world_part for world_part in world.bodies if world_part.part == part) for part in ("body", "cap", *more)
    )
    x, y, z = configuration.bench.places["nest"].spot(0).position_m
    world.place(body, Pose((x, y, z)))
    z += product.parts["body"].size_m[2]
    for other in (cap, *others):
        world.place(other, Pose((x + off_m, y, z)))
        z += product.parts[other.part].size_m[2]
    world.settle()
    return world, body, cap


def family(folder: Path, **made_of: list[str]) -> Path:
    """The same cell with a lid, and with further sub-assemblies, each in a goal of its own."""
    product = yaml.safe_load((PATH.parent / "product.yaml").read_text())
    cell = yaml.safe_load(PATH.read_text())
    lid = {"title": "lid", "colour_rgb": [0.9, 0.1, 0.9], "peg_length_m": 0.0, "peg_diameter_m": 0.0}
    product["parts"]["lid"] = product["parts"]["cap"] | lid
    for number, (name, parts) in enumerate(made_of.items()):
        product["parts"][name] = {"title": name, "made_of": parts, "built_at": "nest"}
        product["goals"][f"g{5 + number}"] = ["o2", "o2", name, "o3"]
        cell["bench"]["places"]["nest"]["holds"].append(name)
    cell["bench"]["bins_m"]["lid"] = [1.02, 0.53, 0.004]
    (folder / "product.yaml").write_text(yaml.safe_dump(product))
    (folder / "cell.yaml").write_text(yaml.safe_dump(cell))
    return folder / "cell.yaml"


def wait(world: World, joining: Joining, periods: int = 12) -> None:
    for number in range(periods):
        joining.update(number * PERIOD_S, PERIOD_S)
        world.step_period()


def test_what_stands_as_it_should_is_one_body_of_the_wholes_type() -> None:
    world, body, cap = stacked()
    wait(world, Joining(world))
    assert (body.part, world.parts[body.name]) == ("pump", "pump")
    assert cap.name not in world.parts
    assert cap not in world.bodies
    before = world.part_pose(body).inverse() @ world.part_pose(cap)
    world.data.xfrc_applied[body.body, 2] = 4.0  # more than both weigh
    for _ in range(10):
        world.step_period()
    after = world.part_pose(body).inverse() @ world.part_pose(cap)
    assert world.part_pose(body).position_m[2] > 0.06, "out of the nest"
    assert np.allclose(before.position_m, after.position_m, atol=1e-4)


def test_lifting_without_the_weld_leaves_the_cap_behind_the_body() -> None:
    world, body, cap = stacked()
    world.data.xfrc_applied[cap.body, 2] = 4.0
    for _ in range(10):
        world.step_period()
    assert world.part_pose(cap).position_m[2] - world.part_pose(body).position_m[2] > 0.1


def test_taken_apart_both_are_themselves_again() -> None:
    world, body, cap = stacked()
    wait(world, Joining(world))
    assert world.split(body) == [cap]
    assert (world.parts[body.name], world.parts[cap.name]) == ("body", "cap")
    assert world.split(body) == []
    world.data.xfrc_applied[cap.body, 2] = 4.0
    for _ in range(10):
        world.step_period()
    assert world.part_pose(cap).position_m[2] > 0.1


@pytest.mark.parametrize(
    ("other", "more", "built"),
    [(["body", "lid"], (), "pump"), (["body", "cap", "lid"], ("lid",), "other"), (["body", "cap", "lid"], (), "pump")],
)
def test_sub_assemblies_may_share_parts_and_begin_alike(
    other: list[str], more: tuple[str, ...], built: str, tmp_path: Path
) -> None:
    world, body, _ = stacked(0.0, family(tmp_path, other=other), *more)
    wait(world, Joining(world), 30)
    assert (body.part, world.parts[body.name]) == (built, built)
    assert len(world.split(body)) == 1 + len(more)
    assert body.part == "body"


def test_a_cap_that_stands_beside_is_not_joined() -> None:
    world, body, _ = stacked(off_m=0.2)
    wait(world, Joining(world))
    assert body.part == "body"


def test_the_robots_tray_holds_no_wholes_and_none_of_their_parts() -> None:
    configuration = load_configuration(PATH)
    types = set(full_set(load_product(configuration, PATH)))
    assert types == {"o2", "o3"}


@pytest.mark.slow
def test_the_person_builds_it_and_the_robot_puts_it_in_whole(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--goal", "g0", "--seed", "771001", "--look", "none", "--json", "--log", str(tmp_path / "run.mcap")]
    assert main(["run", "--config", str(PATH), *options]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["correct"]
    assert told["placements"]["p1"] == "pump"
    assert told["robot_placements"] >= 1
