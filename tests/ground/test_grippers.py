"""Grippers by files: which holds they offer for a part, what they refuse and why, and what they look like."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml

from bracket_cell.configuration import DEFAULT_CONFIGURATION, load_configuration, load_product
from bracket_cell.learned.grasp.settings import WITH_MARGINS, GripperOutline, outline_of
from bracket_cell.running.gripper_checks import GripperMemory
from bracket_cell.skills.drivers.gripper_database import read_frames
from bracket_ground.errors import InputError
from bracket_ground.interfaces.grip import Grip
from bracket_ground.interfaces.gripper import FOLDER, Gripper, default_gripper, load_gripper, scaled, shipped_grippers
from bracket_ground.interfaces.observation import GripperState, ObjectStatus
from bracket_ground.interfaces.product import PartType
from bracket_ground.interfaces.solid import Solid

PARTS = load_product(load_configuration(), DEFAULT_CONFIGURATION).parts
LEAST_M = 0.003
PLATE = PartType(title="plate", size_m=(0.10, 0.09, 0.01), colour_rgb=(0.5, 0.5, 0.5), mass_kg=0.1)


FINGERS, CUP = (yaml.safe_load((FOLDER / f"{name}.yaml").read_text())[key]
                for name, key in (("2f85", "fingers"), ("cup", "cup")))  # fmt: skip


def text_of(name: str, **changes: object) -> dict[str, object]:
    return {**yaml.safe_load((FOLDER / f"{name}.yaml").read_text()), **changes}


@pytest.mark.parametrize("name", shipped_grippers())
@pytest.mark.parametrize("part", PARTS)
def test_a_hold_lies_on_the_part_and_within_what_the_gripper_can(name: str, part: str) -> None:
    gripper, kind = load_gripper(name), PARTS[part]
    grips = gripper.grips(kind, LEAST_M)
    assert bool(grips) is not bool(gripper.why_not(kind, LEAST_M))
    for grip in grips:
        tips_m = gripper.tips_m(kind, grip, 0.022, LEAST_M)
        assert 0 < tips_m <= kind.size_m[2]
        for hold in gripper.holds(kind, grip, tips_m):
            assert abs(hold.place_m) <= kind.size_m[1 - grip.axis] / 2
        assert 0 < gripper.opening_for(kind, grip, LEAST_M) <= gripper.stroke_m


def test_narrower_fingers_say_how_wide_a_part_may_be() -> None:
    assert load_gripper("hand_e").why_not(PLATE, LEAST_M) == "is 90 mm wide; it takes at most 44 mm"
    assert load_gripper("2f140").grips(PLATE, LEAST_M) == (Grip.WIDTH, Grip.LENGTH)


@pytest.mark.parametrize("name", [name for name in shipped_grippers() if not load_gripper(name).nothing])
def test_no_hold_is_offered_for_a_part_beyond_the_payload(name: str) -> None:
    heavy = PARTS["o1"].model_copy(update={"mass_kg": 6.0})
    assert load_gripper(name).grips(heavy, LEAST_M) == ()
    assert load_gripper(name).why_not(heavy, LEAST_M).startswith("weighs 6 kg; it takes at most ")


@pytest.mark.parametrize(("name", "weakly"), [("cup", {"vacuum_kpa": 4, "held_kpa": 3}), ("magnet", {"most_n": 1.25})])
def test_no_more_is_held_than_what_pulls(name: str, weakly: dict[str, float], tmp_path: Path) -> None:
    text = text_of(name)
    (tmp_path / "weak.yaml").write_text(yaml.safe_dump({**text, name: {**text[name], **weakly}}))  # type: ignore[dict-item]
    kind = PLATE.model_copy(update={"mass_kg": 0.15, "magnetic": True})
    assert load_gripper(name).why_not(kind, LEAST_M) == ""
    words = load_gripper("weak.yaml", tmp_path).why_not(kind, LEAST_M)
    assert words.startswith("weighs 0.15 kg; it takes at most 0.12")


def test_fingers_that_hardly_open_take_nothing(tmp_path: Path) -> None:
    (tmp_path / "shut.yaml").write_text(yaml.safe_dump(text_of("2f85", fingers={**FINGERS, "stroke_m": 0.001})))
    assert load_gripper("shut.yaml", tmp_path).why_not(PLATE, LEAST_M) == "is 90 mm wide; it takes at most 0 mm"


def test_a_cup_holds_a_plate_on_its_top_and_a_grate_nowhere() -> None:
    cup = load_gripper("cup")
    (hold,) = cup.holds(PLATE, Grip.TOP, 0.0)
    assert (hold.grip, hold.place_m) == (Grip.TOP, 0.0)
    bars = [{"solid": "box", "size_m": [0.10, 0.01, 0.01], "centre_m": [0, y, 0.005]} for y in (-0.04, 0.0, 0.04)]
    grate = PartType.model_validate({**PLATE.model_dump(), "shape": bars})
    assert cup.why_not(grate, LEAST_M) == "has no flat face of 20 mm on top"


def test_a_cup_finds_the_face_beside_a_knob() -> None:
    knob = {"solid": "cylinder", "size_m": [0.012, 0.012, 0.02], "centre_m": [0, 0, 0.02]}
    foot = {"solid": "box", "size_m": [0.10, 0.09, 0.02], "centre_m": [0, 0, 0.01]}
    kind = PartType.model_validate({**PLATE.model_dump(), "size_m": (0.1, 0.09, 0.03), "shape": [foot, knob]})
    cup = load_gripper("cup")
    (hold,) = cup.holds(kind, Grip.TOP, 0.0)
    assert 0.016 <= abs(hold.place_m) <= 0.020
    assert cup.tips_m(kind, Grip.TOP, 0.022, LEAST_M) == pytest.approx(0.02, abs=0.0015)


def test_the_usual_gripper_is_as_the_network_knows_it_and_as_the_frames_say() -> None:
    assert outline_of(default_gripper()) == GripperOutline()
    assert outline_of(default_gripper(), margins=True) == WITH_MARGINS
    assert scaled(read_frames(), default_gripper()) == read_frames()
    assert "0.196" in scaled(read_frames(), load_gripper("hand_e"))  # 50 mm in 255 steps


def test_fingers_move_apart_by_the_opening_and_keep_to_their_pads() -> None:
    for name in ("2f85", "2f140", "hand_e"):
        gripper = load_gripper(name)
        (left, size), (right, _) = gripper.moving(0.03).values()
        assert gripper.fingers is not None
        np.testing.assert_allclose(left[0] - right[0], 0.03 + gripper.fingers.pads_m[0])
        assert left[2] + size[2] / 2 == pytest.approx(gripper.tip_m)
        assert left[2] - size[2] / 2 == pytest.approx(gripper.palm_m[2])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"fingers": None}, "give one of fingers, cup, magnet, or nothing: true"),
        ({"nothing": True}, "give one of fingers, cup, magnet, or nothing: true"),
        ({"palm_m": [0.1, 0.06, 0.3]}, "beyond the tips"),
        ({"stroke": 0.05}, "unknown key 'stroke'"),
        ({"fingers": {**FINGERS, "force_n": [235, 20]}}, "force_n is the least and the most: 235 is above 20"),
        ({"fingers": {**FINGERS, "speed_m_s": [0.2, 0.1]}}, "speed_m_s is the least and the most"),
        ({"fingers": {**FINGERS, "pads_m": [0.012, 0.025, 0.2]}}, "pads_m: 0.2 long, and fingers end 0.164 from"),
        ({"with_part_kg": 0.5}, "with_part_kg 0.5 is less than mass_kg 0.91"),
        ({"fingers": None, "cup": {**CUP, "diameter_m": 0.005}}, "lip_m 0.003 all around leaves nothing"),
    ],
)
def test_a_wrong_file_is_refused_with_its_key(changes: dict[str, object], words: str, tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(text_of("2f85", **changes)))
    with pytest.raises(InputError, match=words):
        load_gripper("mine.yaml", tmp_path)
    with pytest.raises(ValueError, match="legal: 2f140, 2f85, cup, hand_e, magnet, none, or a gripper"):
        load_gripper("another.yaml", tmp_path)


def test_a_cup_that_says_it_holds_without_its_pressure_contradicts_itself() -> None:
    def told(kpa: float) -> str:
        memory = GripperMemory.of(load_gripper("cup"))
        state = GripperState(1.0, True, ObjectStatus.CONTACT_CLOSING, 0.0, 0.0, 0, "operational", vacuum_kpa=kpa)
        memory.see(state, 1.0)
        return memory.contradicts

    assert told(40.0) == ""
    assert told(20.0) == "the cup says that it holds, at 20 kPa"
    assert told(float("nan")).startswith("the cup says that it holds")


def test_a_magnet_holds_flat_steel_alone_and_only_where_its_device_tells() -> None:
    magnet, steel = load_gripper("magnet"), PLATE.model_copy(update={"magnetic": True})
    assert magnet.grips(steel, LEAST_M) == (Grip.TOP,)
    assert magnet.why_not(PLATE, LEAST_M) == "is not magnetic"
    ball = Solid(solid="ball", size_m=(0.1, 0.1, 0.1), centre_m=(0, 0, 0.05))
    dome = PartType.model_validate({**steel.model_dump(), "size_m": (0.1, 0.1, 0.1), "shape": [ball.model_dump()]})
    assert magnet.why_not(dome, LEAST_M) == "has no flat face of 20 mm on top"
    silent = Gripper.model_validate(text_of("magnet", magnet={"diameter_m": 0.02, "most_n": 60, "tells": False}))
    assert silent.grips(steel, LEAST_M) == ()
    assert "does not tell whether it holds" in silent.why_not(steel, LEAST_M)


def test_nothing_on_the_flange_holds_nothing_and_is_in_no_way() -> None:
    nothing = load_gripper("none")
    assert nothing.grips(PLATE, LEAST_M) == nothing.known == ()
    assert nothing.why_not(PLATE, LEAST_M) == "the arm has no gripper"
    assert nothing.moving(0.0) == {}


def test_a_file_that_is_dumped_is_read_again() -> None:
    for name in shipped_grippers():
        gripper = load_gripper(name)
        assert Gripper.model_validate(gripper.model_dump(mode="json")) == gripper
