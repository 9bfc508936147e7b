"""The plan in sentences, in both languages, and a product as text and as a picture."""

from __future__ import annotations

from xml.etree import ElementTree

import yaml

from bracket_cell.viewing.guidance import guidance_sentences
from bracket_cell.viewing.product_picture import product_picture, product_text
from bracket_ground.files.words.catalogue import catalogue
from bracket_ground.interfaces.planning import AssemblyPlan
from bracket_ground.interfaces.product import Product
from tests import ROOT

FASTENED = Product.model_validate(yaml.safe_load((ROOT / "config/examples/fastened/product.yaml").read_text()))


def test_a_plan_is_told_in_sentences_of_both_languages() -> None:
    said = guidance_sentences({"o1": ("p3", "p5"), "o2": ()}, ("p4",), FASTENED, {"p1", "p2", "s1"})
    assert [str(one) for one in said] == [
        "The gate valve (o1) goes into p3 and p5",
        "No globe valve (o2) is left to place",
        "What goes into p4 is not sure yet",
        "Before p3 comes screw M8 at p2",
        "Now screw M8 at p2",
    ]
    german = [catalogue("de")(one) for one in said]
    assert german[0] == "gate valve (o1) gehört in p3 und p5"
    assert all(one != other for one, other in zip(german, said, strict=True))


def test_a_slot_is_sure_or_unsure_never_both_and_slots_come_in_their_order() -> None:
    to = {"o1": ("p10", "p2"), "o2": ("p2", "p9")}
    belief = {("o1", "p2"): 1.0, ("o2", "p2"): 0.5, ("o1", "p10"): 0.5, ("o2", "p9"): 0.5}
    plan = AssemblyPlan({"g0": 0.5, "g1": 0.5}, belief, "o1", to)
    positions = [f"p{number}" for number in range(1, 11)]
    assert plan.shared(0.9, positions) == ({"o1": ("p2",)}, ("p9", "p10"))


def test_of_a_slot_that_takes_either_type_one_sentence_says_so() -> None:
    said = guidance_sentences({"o1": ("p1", "p2"), "o2": ("p2", "p3"), "o3": ("p2", "p3")})
    assert [str(one) for one in said] == [
        "The o1 goes into p1",
        "The o1, o2 or o3 goes into p2",
        "The o2 or o3 goes into p3",
    ]


def test_a_product_is_written_in_an_order_that_it_allows() -> None:
    lines = [line.strip() for line in product_text(FASTENED).splitlines()]
    assert lines[0] == "valve bracket, fastened: one of 3 goals"
    assert lines.index("s1: screw M8 at p1, after p1") < lines.index("p2: gate valve (o1), after s1")
    assert "s3: screw M8 at p3 to 8 Nm, after p3" in lines


def test_the_picture_has_a_box_for_each_goal_and_step_and_an_arrow_for_each_before() -> None:
    root = ElementTree.fromstring(product_picture(FASTENED))
    space = "{http://www.w3.org/2000/svg}"
    assert len(root.findall(f"{space}rect")) == 1 + len(FASTENED.goals) + 6 + 3
    arrows = [one for one in root.findall(f"{space}path") if one.get("marker-end")]
    assert len(arrows) == sum(map(len, FASTENED.predecessors.values()))
