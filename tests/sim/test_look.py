"""Looks: drawn from the seed knob by knob, with units and limits, and files that say where they are wrong."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from bracket_ground.errors import InputError
from bracket_ground.files.model import Location
from bracket_sim.scene.look import NOMINAL, Look
from bracket_sim.scene.look_range import LookRange, leaves, look_range, presets

DIRECTIONS = ("azimuth_rad", "elevation_rad", "lean_side_m", "glove_hsv.0", "left_hand", "glove")


def dotted(location: Location) -> str:
    return ".".join(map(str, location))


def ranges(name: str) -> dict[str, tuple[float, float]]:
    looks = look_range(name)
    return {dotted(place): (low, high) for place, low, high in leaves(looks.low.model_dump(), looks.high.model_dump())}


def test_the_same_seed_gives_the_same_look_and_another_one_another() -> None:
    assert look_range("varied").draw(3) == look_range("varied").draw(3)
    assert look_range("varied").draw(3) != look_range("varied").draw(4)


def test_nominal_is_one_look() -> None:
    assert look_range("nominal").draw(5) == NOMINAL == Look()


@pytest.mark.parametrize("name", ["varied", "hard", "wide", "people", "human"])
def test_every_drawn_value_is_within_its_range(name: str) -> None:
    for seed in range(20):
        drawn = look_range(name).draw(seed).model_dump()
        found = {dotted(place): value for place, value, _ in leaves(drawn, drawn)}
        assert all(low <= found[place] <= high for place, (low, high) in ranges(name).items())


def test_a_value_that_is_fixed_changes_no_other() -> None:
    fixed = LookRange.model_validate({"base": "varied", "person": {"skin_tone": 0.9}})
    drawn, before = fixed.draw(8).model_dump(), look_range("varied").draw(8).model_dump()
    changed = [dotted(place) for place, one, other in leaves(drawn, before) if one != other]
    assert changed == ["person.skin_tone"]


def test_hard_lies_outside_varied_in_all_but_directions_and_sides() -> None:
    varied, hard = ranges("varied"), ranges("hard")
    for place, (low, high) in hard.items():
        if varied[place][0] == varied[place][1] == low == high or place.endswith(DIRECTIONS):
            continue
        if place in ("light.lamps_n", "light.shadows", "camera.jpeg", "person.second_hand"):  # the worse of what varies
            assert low == high
        elif "position_m" not in place:
            assert high < varied[place][0] or low > varied[place][1], place
    for lamp in range(3):  # lower above the table than any lamp that varies
        height = f"light.lamps.{lamp}.position_m.2"
        assert hard[height][1] < varied[height][0] + 0.01


def test_every_knob_of_varied_varies_or_is_told_not_to() -> None:
    fixed = {place for place, (low, high) in ranges("varied").items() if low == high}
    assert fixed == {"camera.distortion_k2", "camera.depth_holes", "person.hand"}


def test_every_number_has_a_unit_and_limits() -> None:
    schema = Look.model_json_schema()
    for name, model in {"Look": schema, **schema["$defs"]}.items():
        for key, field in model["properties"].items():
            if field.get("type") in ("number", "integer"):
                assert "unit" in field, f"{name}.{key}"
                assert {"minimum", "maximum"} <= field.keys(), f"{name}.{key}"
            for item in field.get("prefixItems", ()):
                assert "$ref" in item or {"minimum", "maximum"} <= item.keys(), f"{name}.{key}"


def test_a_drawn_look_is_itself_a_look_file(tmp_path: Path) -> None:
    drawn = look_range("varied").draw(2)
    path = tmp_path / "drawn.yaml"
    path.write_text(yaml.safe_dump(drawn.model_dump(mode="json")))
    assert look_range(str(path)).draw(77) == drawn


def test_a_section_of_a_preset_leaves_the_rest_nominal() -> None:
    drawn = look_range("hard:light").draw(1)
    assert drawn.light != NOMINAL.light
    assert drawn.model_copy(update={"light": NOMINAL.light}) == NOMINAL


BAD_FILES = {
    "light:\n  lamp_n: 3\n": "2:3: unknown key 'lamp_n'; did you mean 'lamps_n'? legal here: lamps_n, lamps",
    "light:\n  lamps_n: [1, 4]\n": "2:12: light.lamps_n: input should be less than or equal to 3, not 4",
    "person:\n  skin_tone: [.9, .2]\n": "2:14: the range from 0.9 to 0.2 runs backwards",
    "base: varid\n": "1:7: base: no such preset; legal: nominal, bare, hard, human, people, varied, wide, not 'varid'",
    "surfaces:\n  table_rgb: [1, 0]\n": "2:14: surfaces.table_rgb",
    "- 3\n": "1:1",
    "hello, no look\n": "1:1: the file: input should be keys with values, not 'hello, no look'; legal here: light, ",
}


@pytest.mark.parametrize(("text", "complaint"), BAD_FILES.items())
def test_a_bad_look_file_is_told_with_line_and_column(tmp_path: Path, text: str, complaint: str) -> None:
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        look_range("bad.yaml", tmp_path)
    assert f"{path}:{complaint}" in str(caught.value)


def test_problems_at_both_ends_of_ranges_are_told_at_once(tmp_path: Path) -> None:
    (tmp_path / "bad.yaml").write_text("person:\n  skin_tone: [0.6, 7]\n  hand_size: [9, 1]\n  glov: true\n")
    with pytest.raises(InputError) as caught:
        look_range("bad.yaml", tmp_path)
    told = str(caught.value).splitlines()
    assert len(told) == 3
    assert all(word in line for word, line in zip(("skin_tone", "hand_size", "'glov'"), told, strict=True))


@pytest.mark.parametrize("name", ["hardest", "hard:lights", "no/such.yaml"])
def test_an_unknown_look_is_refused_with_the_legal_ones(name: str) -> None:
    with pytest.raises(InputError, match="legal: "):
        look_range(name)


def test_the_presets_are_the_shipped_files() -> None:
    assert presets() == ["nominal", "bare", "hard", "human", "people", "varied", "wide"]
