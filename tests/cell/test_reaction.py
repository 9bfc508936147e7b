"""The reaction of the separation, and the limits of late ticks, follow from the control loop's period."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from bracket_cell.configuration import (
    DEFAULT_CONFIGURATION,
    Configuration,
    load_configuration,
    load_faults,
    load_product,
)
from bracket_cell.configuration import weaknesses as weak
from bracket_cell.running.supervisor import make_supervisor
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_ground.interfaces.faults import Action
from tests.cell.running.test_supervisor import sound


def configured(folder: Path, tick_hz: float, separation: dict[str, Any] | None = None, **arm: Any) -> Configuration:
    data = yaml.safe_load(DEFAULT_CONFIGURATION.read_text())
    data |= {"product": str(DEFAULT_CONFIGURATION.with_name("products.yaml"))}
    data["controller"]["tick_hz"] = tick_hz
    data["motion"] = {"separation": separation or {}}
    data["devices"] = {"arm": arm} if arm else {}
    path = folder / "cell.yaml"
    path.write_text(yaml.safe_dump(data))
    return load_configuration(path)


@pytest.mark.parametrize(
    ("tick_hz", "reaction_s"), [(25.0, 0.078), (5.0, 0.238), (10.0, 0.138), (50.0, 0.078), (500.0, 0.078)]
)
def test_the_reaction_is_a_tick_the_arm_s_cycle_and_what_joints_trail_and_never_less_than_at_25_hz(
    tmp_path: Path, tick_hz: float, reaction_s: float
) -> None:
    configuration = configured(tmp_path, tick_hz)
    assert configuration.motion.separation.reaction_s == pytest.approx(reaction_s)
    assert weak(configuration, load_faults(configuration)) == []


def test_an_arm_that_trails_its_set_points_by_more_reacts_later(tmp_path: Path) -> None:
    configuration = configured(tmp_path, 25.0, kind="ur", host="192.0.2.1", lag_s=0.1)
    assert configuration.motion.separation.reaction_s == pytest.approx(0.148)


def test_a_reaction_that_is_shorter_than_the_loop_s_is_weaker_than_what_is_shipped(tmp_path: Path) -> None:
    configuration = configured(tmp_path, 5.0, {"reaction_s": 0.078})
    (told,) = weak(configuration, load_faults(configuration))
    assert told.startswith("motion.separation.reaction_s 0.078 is less than 0.238")
    assert "controller.tick_hz" in told
    assert weak(configured(tmp_path, 5.0, {"reaction_s": 0.3}), load_faults(configuration)) == []
    assert configured(tmp_path, 25.0, {"reaction_s": 0.3}).motion.separation.reaction_s == 0.3


@pytest.mark.parametrize(
    ("tick_hz", "late_s", "action"),
    [
        (25.0, 0.079, Action.RUN),
        (25.0, 0.081, Action.SLOW),
        (25.0, 0.401, Action.STOP),
        (5.0, 0.39, Action.RUN),
        (5.0, 0.41, Action.SLOW),
        (5.0, 2.01, Action.STOP),
        (500.0, 0.079, Action.RUN),
        (500.0, 0.081, Action.SLOW),
    ],
)
def test_a_tick_is_late_by_the_loop_s_own_period(tmp_path: Path, tick_hz: float, late_s: float, action: Action) -> None:
    configuration = configured(tmp_path, tick_hz)
    motion = MotionPlanner(load_product(configuration), configuration.bench, configuration.motion)
    supervisor = make_supervisor(load_faults(configuration), motion)
    assert supervisor.judge(replace(sound(0), late_s=late_s)).action is action
