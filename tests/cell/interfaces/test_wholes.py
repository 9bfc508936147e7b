"""Sub-assemblies: what follows from their parts, and product files and benches that cannot build them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.viewing.guidance import guidance_sentences
from bracket_cell.viewing.product_picture import product_text
from bracket_ground.errors import InputError
from bracket_ground.interfaces.product import Product
from tests import ROOT

FOLDER = ROOT / "config" / "examples" / "subassembly"
FILE: dict[str, Any] = yaml.safe_load((FOLDER / "product.yaml").read_text())


def test_a_whole_has_the_shape_and_the_mass_of_its_parts() -> None:
    product = Product.model_validate(FILE)
    pump, body, cap = (product.parts[name] for name in ("pump", "body", "cap"))
    assert pump.size_m == pytest.approx((0.060, 0.044, 0.050))
    assert pump.mass_kg == pytest.approx(body.mass_kg + cap.mass_kg)
    assert (pump.peg_length_m, pump.colour_rgb) == (body.peg_length_m, cap.colour_rgb)
    assert [solid.centre_m[2] for solid in pump.solids][-1] == pytest.approx(0.030 + 0.010)
    assert (body.quantity, cap.quantity, pump.quantity) == (1, 1, 1)
    assert product.assembled == ("body", "cap", "o2", "o3")


@pytest.mark.parametrize(
    ("pump", "words"),
    [
        ({"made_of": ["body"]}, "two parts or more"),
        ({"made_of": ["body", "lid"]}, "'lid' is no single part; legal: body, cap, o2, o3"),
        ({"made_of": ["body", "pump"]}, "'pump' is no single part"),
        ({"made_of": ["body", "o2"]}, "takes o2 by itself"),
        ({"built_at": ""}, "built_at is missing"),
        ({"made_of": []}, "size_m"),
        ({"made_of": 3}, "made_of"),
    ],
)
def test_what_cannot_be_built_is_told(pump: dict[str, Any], words: str) -> None:
    parts = {**FILE["parts"], "pump": {**FILE["parts"]["pump"], **pump}}
    with pytest.raises(ValueError, match=words):
        Product.model_validate({**FILE, "parts": parts})


def test_two_of_the_same_parts_are_told() -> None:
    parts = {**FILE["parts"], "twin": FILE["parts"]["pump"]}
    with pytest.raises(ValueError, match="is that of pump, too"):
        Product.model_validate({**FILE, "parts": parts})


@pytest.mark.parametrize(
    ("nest", "words"),
    [
        ("{position_m: [0.81, -0.34, 0.03], seat: hole}", "the camera sees"),
        ("{position_m: [0.81, -0.34, 0.03], seat: hole, known_by: seen, holds: [body]}", "holds pump, too"),
        (None, "is in bench.places; legal: none yet"),
    ],
)
def test_the_place_must_see_and_hold_it(nest: str | None, words: str, tmp_path: Path) -> None:
    cell = yaml.safe_load((FOLDER / "cell.yaml").read_text())
    cell["bench"]["places"] = {} if nest is None else {"nest": yaml.safe_load(nest)}
    (tmp_path / "product.yaml").write_text((FOLDER / "product.yaml").read_text())
    path = tmp_path / "cell.yaml"
    path.write_text(yaml.safe_dump(cell))
    with pytest.raises(InputError, match=words) as refused:
        load_product(load_configuration(path), path)
    assert "product.yaml:" in str(refused.value)


def test_it_is_told_in_words() -> None:
    product = Product.model_validate(FILE)
    assert "p1: pump (pump), built at nest of body, cap" in product_text(product)
    told = [
        str(guidance_sentence)
        for guidance_sentence in guidance_sentences({"body": (), "cap": (), "pump": ("p1",)}, product=product)
    ]
    assert told == ["The pump (pump) goes into p1", "Build the pump (pump) at nest of body (body) and cap (cap)"]
