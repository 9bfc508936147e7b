"""The model cards beside the weights are those of their metadata."""

from __future__ import annotations

from pathlib import Path

import onnx
import pytest
from pydantic import JsonValue

from bracket_cell.kinds import WEIGHTS
from bracket_cell.learned.inference.onnx_model import ModelCard, save_onnx
from bracket_lab.learned.training.cards import CARDS, LICENCE, NOT_RECORDED, cards
from tests import ROOT

UNKNOWN = f"source: {NOT_RECORDED}; licence: {NOT_RECORDED}"


def test_the_cards_beside_the_weights_are_those_of_their_metadata() -> None:
    assert CARDS.read_text() == cards(WEIGHTS), "run: python -m bracket_lab.learned.training.cards"


def test_every_file_of_weights_has_a_card_with_a_licence() -> None:
    sections = CARDS.read_text().split("\n## ")[1:]
    assert [section.split("\n")[0] for section in sections] == sorted(path.name for path in WEIGHTS.glob("*.onnx"))
    assert all(f"| licence | {LICENCE} |" in section for section in sections)


def test_weights_are_of_the_projects_licence() -> None:
    assert f'license = "{LICENCE}"' in (ROOT / "cell" / "pyproject.toml").read_text()


def test_the_card_has_number_and_licence_of_photographs_by_source(tmp_path: Path) -> None:
    config: dict[str, JsonValue] = {
        "photographs": {"gestures": "31 (CC-BY-4.0)", "tools, without hands": "9 (CC0-1.0)"}
    }
    card = ModelCard(kind="hands.slim", config=config, vocabulary={}, data_sha256="", command="", seed=0)
    save_onnx(onnx.load(WEIGHTS / "semantic_factored.onnx"), tmp_path / "some.onnx", card)
    assert "| photographs | gestures: 31 (CC-BY-4.0); tools, without hands: 9 (CC0-1.0) |" in cards(tmp_path)


@pytest.mark.parametrize(("config", "told"), [({"then": "with photographs beside"}, True), ({"epochs": 2}, False)])
def test_the_card_says_what_is_not_known_of_photographs(
    tmp_path: Path, config: dict[str, JsonValue], told: bool
) -> None:
    card = ModelCard(kind="hands.slim", config=config, vocabulary={}, data_sha256="", command="", seed=0)
    save_onnx(onnx.load(WEIGHTS / "semantic_factored.onnx"), tmp_path / "some.onnx", card)
    text = cards(tmp_path)
    assert (UNKNOWN in text) == told
    assert f"| made by | {NOT_RECORDED} |" in text
