"""Product families: empty slots, alternatives, quantities, precedence, fastenings, several brackets."""

from __future__ import annotations

from contextlib import suppress
from itertools import permutations, product
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from bracket_cell.learned.semantic.goals import FinishedGoal, OpenGoals
from bracket_ground.errors import InputError
from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.variants import EMPTY, arrangements
from tests import ROOT
from tests.cell.log.hostile import EDITS, flipped

BASE: dict[str, Any] = yaml.safe_load((ROOT / "config" / "products.yaml").read_text())
BALL = {"solid": "ball", "size_m": [0.045, 0.028, 0.020], "centre_m": [0.0, 0.0, 0.010]}
EXAMPLES = sorted((ROOT / "config" / "examples").glob("*/product.yaml"))


def family(**changes: Any) -> Product:
    bare = {
        name: {key: value for key, value in part.items() if key != "quantity"} for name, part in BASE["parts"].items()
    }
    return Product.model_validate({**BASE, "parts": bare, **changes})


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.parent.name)
def test_every_example_says_the_same_after_it_was_written_and_read(path: Path) -> None:
    beside = {"folder": path.parent}
    read = Product.model_validate(yaml.safe_load(path.read_text()), context=beside)
    assert Product.model_validate(read.model_dump(mode="json"), context=beside) == read
    for goal in read.goals:
        placed: dict[str, str] = {}
        for step in read.steps(goal):
            assert not read.missing_before(step, {*placed, *read.fastenings}, read.accepted(goal))
            if step in read.positions:
                placed[step] = read.goal_placements(goal, placed)[step]
                assert read.fits(goal, placed)
        assert read.goal_placements(goal, placed) == placed


def test_a_slot_may_stay_empty_and_goals_may_be_by_slot() -> None:
    some = family(goals={"a": {"p1": "o1", "p3": ["o1", "o2"]}, "b": ["o3", *[EMPTY] * 5]}, goal_titles={})
    assert some.goals["a"] == ("o1", EMPTY, ("o1", "o2"), EMPTY, EMPTY, EMPTY)
    assert some.goal_placements("a", {"p3": "o2"}) == {"p1": "o1", "p3": "o2"}
    assert some.goal_of({"p3": "o2", "p1": "o1"}) == "a"
    assert some.goal_of({"p1": "o1"}) is None
    assert some.varies
    assert {name: part.quantity for name, part in some.parts.items()} == {"o1": 2, "o2": 1, "o3": 1}


def test_of_goals_that_parts_make_the_narrowest_is_named() -> None:
    wide, narrow = {"p1": "o1", "p3": ["o1", "o2"]}, {"p1": "o1", "p3": "o2"}
    some = family(goals={"any": wide, "one": narrow, "other": {"p1": "o3"}}, goal_titles={})
    assert some.goal_of(narrow) == "one"
    assert some.goal_of({"p1": "o1", "p3": "o1"}) == "any"
    goals = OpenGoals.of(some)
    assert goals.with_bracket(some.as_listed(narrow)).finished.keys() == {"one"}
    for name in ("any", "one"):  # as earlier versions wrote it, too
        OpenGoals(some, {name: FinishedGoal(parts=some.as_listed(narrow), finished=1)}).check(Path())


def test_quantities_hold_for_every_completion() -> None:
    """Against listing all arrangements of a goal whose alternatives share their parts."""
    choices = [["o1", "o2"], ["o1", "o2", "o3"], ["o2", "o3"], "o1", "o1", EMPTY]
    limits = {"o1": 3, "o2": 1}
    some = family(goals={"a": choices}, goal_quantities={"a": limits}, goal_titles={})
    legal = set(arrangements(some.goals["a"], limits, 1000))
    assert legal
    for slots in permutations(some.positions[:3], 2):
        for parts in product(["o1", "o2", "o3"], repeat=2):
            placed = dict(zip(slots, parts, strict=True))
            at = {some.positions.index(slot): part for slot, part in placed.items()}
            possible = [one for one in legal if all(one[index] == part for index, part in at.items())]
            assert some.fits("a", placed) == bool(possible), placed
            assert some.as_listed(some.goal_placements("a", placed)) in legal


def test_what_precedes_an_empty_slot_precedes_what_follows_it() -> None:
    some = family(
        goals={"a": {"p1": "o1", "p3": "o2"}, "b": {"p1": "o3"}},
        goal_titles={},
        before=[["p1", "p2"], ["p2", "f"], ["f", "p3"]],
        fastenings={"f": {"at": ["p2"]}},
    )
    assert some.missing_before("p3", (), some.accepted("a")) == ["p1"]
    assert some.missing_before("p3", {"p1"}, some.accepted("a")) == []
    assert some.missing_before("p3", {"p1"}) == ["f"]
    assert some.steps("a") == ["p1", "p3"]


def test_a_fastenings_turn_comes_when_its_parts_stand() -> None:
    some = family(fastenings={"f": {"at": ["p1", "p2"]}}, before=[["f", "p3"]])
    assert some.unfastened(some.positions, {"p1"}) == []
    assert some.unfastened(some.positions, {"p1", "p2"}) == ["f"]
    assert some.unfastened(some.positions, {"p1", "p2", "f"}) == []
    assert some.steps("g0")[:4] == ["p1", "p2", "p4", "p5"]


def test_two_brackets_are_built_as_any_goals() -> None:
    some = family(brackets={"a": [0.0, 0.0], "b": [0.2, 0.0]}, before=[["p1", "p2"]])
    assert len(some.goals) == 9
    assert some.bracket.holes_m["b_p1"] == (0.2, BASE["bracket"]["holes_m"]["p1"][1])
    assert some.goal_placements("g0+g2")["a_p6"] == "o3"
    assert some.goal_placements("g0+g2")["b_p3"] == "o3"
    assert some.missing_before("b_p2", ()) == ["b_p1"]
    assert some.parts["o1"].quantity == 6


def beside(tmp_path: Path, **changes: Any) -> Product:
    """The product with the bracket of another file beside it, which takes a type that only that file knows."""
    small = {**BASE, "name": "small", "goal_titles": {"s": "small"}, "goals": {"s": ["o4", "o1"]}}
    small["bracket"] = {**BASE["bracket"], "holes_m": {"a": [0.0, 0.05], "b": [0.0, -0.05]}}
    small["parts"] = {"o1": {**BASE["parts"]["o1"], "quantity": 1}, "o4": {**BASE["parts"]["o2"], "quantity": 1}}
    small["before"] = [["b", "a"]]
    (tmp_path / "small.yaml").write_text(yaml.safe_dump({**small, **changes}))
    path = tmp_path / "product.yaml"
    entries = {"big": [0.0, 0.0], "small": {"at_m": [0.2, 0.0], "file": "small.yaml", "may_stay_empty": True}}
    path.write_text(yaml.safe_dump({**BASE, "brackets": entries}))
    return load_yaml(path, Product)


def test_a_bracket_of_another_file_has_its_own_holes_goals_steps_and_parts(tmp_path: Path) -> None:
    some = beside(tmp_path)
    assert list(some.goals) == ["g0+s", "g0+empty", "g1+s", "g1+empty", "g2+s", "g2+empty"]
    assert some.bracket.holes_m["small_b"] == (0.2, -0.05)
    assert some.bracket.plates[1] == ("small_a", "small_b")
    assert some.goal_placements("g1+s")["small_a"] == "o4"
    assert "small_a" not in some.goal_placements("g1+empty")
    assert some.missing_before("small_a", ()) == ["small_b"]
    assert some.goal_title("g0+s").endswith(", small")
    assert {name: part.quantity for name, part in some.parts.items()} == {"o1": 4, "o2": 2, "o3": 1, "o4": 1}
    assert Product.model_validate(some.model_dump(mode="json")) == some


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"parts": {"o1": {**BASE["parts"]["o1"], "mass_kg": 0.5}, "o4": BASE["parts"]["o2"]}}, "type o1 is another"),
        (
            {"bracket": {**BASE["bracket"], "thickness_m": 0.02, "holes_m": {"a": [0, 0], "b": [0, 0.1]}}},
            "plate of 0.02",
        ),
        ({"brackets": {"small": {"at_m": [0.0, 0.0], "file": "small.yaml"}}}, "has brackets itself"),
        ({"goals": {"s": ["o9", "o1"]}}, "small.yaml"),
    ],
)
def test_a_bracket_of_another_file_that_does_not_go_with_this_one_is_refused(
    changes: dict[str, Any], what: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=what):
        beside(tmp_path, **changes)


def test_a_slot_on_a_part_is_as_high_as_the_part_and_comes_after_it() -> None:
    goals = {"a": ["o3", "o1", "o2", "o1", "o1", "o1"], "b": ["o3", "o2", "o1", "o1", "o1", EMPTY]}
    some = family(goals=goals, goal_titles={}, carried_by={"p2": "p1"})
    assert some.slot_m("p2") == (*BASE["bracket"]["holes_m"]["p2"], BASE["parts"]["o3"]["size_m"][2])
    assert some.slot_m("p1")[2] == 0.0
    assert some.missing_before("p2", ()) == ["p1"]
    assert "p2" not in some.through


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"carried_by": {"p1": "p6"}}, "they must be equally high"),
        ({"carried_by": {"p9": "p1"}}, "no slot p9; slots: p1"),
        ({"carried_by": {"p1": "p2", "p2": "p1"}}, "no step can be the first of these"),
        ({"before": [["p1", "p2"], ["p2", "p1"]]}, "no step can be the first of these"),
        ({"before": [["p1", "p9"]]}, "no step p9; steps: p1"),
        ({"accepts": {"p1": ["o2"]}}, "goal g0 puts o1 into p1, which accepts o2"),
        ({"goals": {"a": {"p9": "o1"}}, "goal_titles": {}}, "no slot p9 in the bracket"),
        ({"goals": {"a": [EMPTY] * 6}, "goal_titles": {}}, "leaves every slot empty"),
        ({"goals": {"a": [["o1", "o1"], *["o2"] * 5]}, "goal_titles": {}}, "goal a lists o1 twice for p1"),
        ({"goals": {"a": [[], *["o2"] * 5]}, "goal_titles": {}}, "goal a lists nothing for p1; write empty"),
        (
            {"goals": {"a": [["o1", "o2"], *["o3"] * 5], "b": [["o2", "o1"], *["o3"] * 5]}, "goal_titles": {}},
            "goal b is the same configuration as a",
        ),
        ({"parts": BASE["parts"], "goals": {"a": [["o1", "o2"]] * 6}, "goal_titles": {}}, "more slots than parts lie"),
        ({"accepts": {"p1": ["o1", "o9"]}}, "no part type o9; part types: o1, o2, o3"),
        ({"accepts": {"p1": []}}, "p1 accepts nothing; part types: o1, o2, o3"),
        ({"bracket": {**BASE["bracket"], "margin_m": 0.01}}, "reach over the plate's edge; legal: more than 0.014 m"),
        (
            {"parts": {**BASE["parts"], "o1": {**BASE["parts"]["o1"], "shape": "box", "size_m": [0.02, 0.02, 0.02]}}},
            "falls through the holes, which are 28 mm wide",
        ),
        ({"parts": {**BASE["parts"], "o1": {**BASE["parts"]["o1"], "shape": [BALL] * 201}}}, "at most 200"),
        ({"goal_quantities": {"g0": {"o1": 2}}}, "more slots than goal_quantities.g0 has parts for"),
        ({"fastenings": {"p1": {"at": ["p2"]}}}, "p1 is a slot; give the fastening another name"),
        ({"fastenings": {"f": {"at": ["p9"]}}}, "no slot p9; slots: p1"),
        ({"goals": {"a": ["o1"] * 6, "b": ["o1"] * 5}, "goal_titles": {}}, "goal b lists 5 parts for 6 positions"),
        ({"goals": {"a": ["o1"] * 7, "b": ["o1"] * 6}, "goal_titles": {}}, "goal a lists 7 parts for 6 positions"),
        ({"goal_titles": {"g0": "one", "g1": "one"}}, "'one' is said of another goal, too"),
        ({"goal_titles": {"g0": "g1"}}, "'g1' is said of another goal, too"),
        (
            {
                "bracket": {**BASE["bracket"], "holes_m": {"tray": [0.0, 0.0]}},
                "goals": {"a": ["o1"]},
                "goal_titles": {},
            },
            "'tray' cannot be the name of a slot: poses",
        ),
    ],
)
def test_what_does_not_fit_is_named(changes: dict[str, Any], what: str) -> None:
    with pytest.raises(ValidationError, match=what):
        family(**changes)


def test_more_combinations_than_a_plan_can_weigh_are_refused_before_they_are_made() -> None:
    with pytest.raises(ValueError, match=r"3 goals at 12 brackets combine to 531441, more than 400"):
        family(brackets={f"b{number}": [0.0, 0.3 * number] for number in range(12)})


@pytest.mark.long
@settings(max_examples=150, deadline=None, database=None, suppress_health_check=list(HealthCheck))
@given(sound=st.sampled_from([*EXAMPLES, ROOT / "config" / "products.yaml"]), edits=EDITS)
def test_whatever_a_product_file_holds_it_is_taken_or_refused_with_places(
    sound: Path, edits: Any, tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("file") / "product.yaml"
    content = flipped(yaml.safe_load(sound.read_text()), edits)
    try:
        path.write_text(yaml.safe_dump(content))
    except yaml.YAMLError:
        return
    with suppress(InputError):
        load_yaml(path, Product)


@pytest.mark.parametrize(
    ("key", "old", "new", "words"),
    [
        ("parts", "o1", "", "is no name"),
        ("parts", "o1", "o\x07", "is no name"),
        ("parts", "o1", "empty", "says that nothing goes into a slot"),
        ("goals", "g0", " ", "is no name"),
        ("goals", "g0", "a, or b", "is no name: it has letters, and none of , ; : { }"),
        ("parts", "o1", "o1;", "is no name"),
        ("parts", "o1", "o1 ", "is no name"),
    ],
)
def test_names_that_nobody_can_read_are_refused(key: str, old: str, new: str, words: str) -> None:
    changed = {new if name == old else name: value for name, value in BASE[key].items()}
    goals = {
        goal: [new if key == "parts" and part == old else part for part in to] for goal, to in BASE["goals"].items()
    }
    with pytest.raises(ValidationError, match=words):
        Product.model_validate({**BASE, "goals": goals, key: changed} if key == "parts" else {**BASE, key: changed})


def test_holes_that_run_into_each_other_are_refused() -> None:
    holes = {**BASE["bracket"]["holes_m"], "p2": [x + 0.01 for x in BASE["bracket"]["holes_m"]["p1"]]}
    with pytest.raises(ValidationError, match="p2 runs into p1: between their middles are 14 mm"):
        family(bracket={**BASE["bracket"], "holes_m": holes})


def test_slots_that_carry_each_other_are_told_where_the_file_says_it(tmp_path: Path) -> None:
    path = tmp_path / "product.yaml"
    path.write_text(yaml.safe_dump({**BASE, "carried_by": {"p1": "p2", "p2": "p1"}}, sort_keys=False))
    line = next(n for n, text in enumerate(path.read_text().splitlines(), 1) if text.startswith("carried_by"))
    with pytest.raises(InputError, match=f":{line}:1: no step can be the first of these"):
        load_yaml(path, Product)


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"goals": {"a": {"p9": "o1"}}, "goal_titles": {}}, r"goals.yaml:\d+:9: no slot p9 in the bracket"),
        (
            {"goals": {"a": [True, *["o1"] * 5]}},
            r"goals.a.0: input should be a list or text, not True; in quotes",
        ),
        ({"before": [["p1", "p2", "p3"]]}, "before.0: at most 2 values are legal here, not 3"),
        ({"before": [["p1"]]}, r"goals.yaml:\d+:3: before.0: value 2 is missing"),
        ({"name": "x" * 300, "goal_titles": {"x" * 300: "b"}}, r"goals.yaml:\d+:\d+: no goal x{40}\.\.\.; legal: g0"),
    ],
)
def test_words_name_the_entry_and_what_is_legal_there(changes: dict[str, Any], what: str, tmp_path: Path) -> None:
    path = tmp_path / "goals.yaml"
    path.write_text(yaml.safe_dump({**BASE, **changes}, sort_keys=False))
    with pytest.raises(InputError, match=what) as caught:
        load_yaml(path, Product)
    assert len(caught.value.problems) == 1


@pytest.mark.parametrize("number", ["3e-2", "0.03", 0])
def test_a_number_in_any_writing_leaves_quantities_to_the_goals(number: object, tmp_path: Path) -> None:
    holes = {**BASE["bracket"]["holes_m"], "p3": [number, 0.04]}
    bare = {name: {**part, "quantity": "3"} if name == "o1" else part for name, part in BASE["parts"].items()}
    bare["o2"] = {key: value for key, value in bare["o2"].items() if key != "quantity"}
    path = tmp_path / "product.yaml"
    path.write_text(yaml.safe_dump({**BASE, "parts": bare, "bracket": {**BASE["bracket"], "holes_m": holes}}))
    assert {name: part.quantity for name, part in load_yaml(path, Product).parts.items()} == {"o1": 3, "o2": 2, "o3": 1}
