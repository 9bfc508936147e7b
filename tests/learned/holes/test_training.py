"""The hole reader's network learns for a few steps and is exported; its threshold keeps its promise. No OpenGL here."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_cell.learned.holes.model import LEAST_EMPTY, LEAST_FILLED, HoleNetwork
from bracket_cell.learned.inference.onnx_model import OnnxModel
from bracket_cell.learned.records import Hole
from bracket_lab.learned.holes.evaluate import Plate

pytestmark = [pytest.mark.torch, pytest.mark.filterwarnings("ignore::DeprecationWarning:torch.*")]

CONFIGURATION = load_configuration()
BENCH, PRODUCT = CONFIGURATION.bench, load_product(CONFIGURATION)
TYPES = (None, *PRODUCT.parts)


def drawn(seed: int) -> Plate:
    """A plate with coloured squares for parts and dark ones for empty holes."""
    rng = np.random.default_rng(seed)
    setup = BENCH.overhead
    image = np.full((setup.height_px, setup.width_px, 3), 150, np.uint8)
    holes = []
    for position, xy in PRODUCT.bracket.holes_m.items():
        part = TYPES[int(rng.integers(len(TYPES)))]
        place = BENCH.bracket.pose.transform(np.array([[*xy, 0.0]]))
        column, row = np.rint(setup.model.project(setup.mount.pose, place)[0]).astype(int)
        colour = (10.0, 10.0, 10.0) if part is None else tuple(255 * level for level in PRODUCT.parts[part].colour_rgb)
        image[row - 5 : row + 6, column - 5 : column + 6] = colour
        holes.append(Hole(position=position, part=part))
    return Plate(f"log{seed // 2}", image, setup.model, setup.mount.pose, setup.mount.pose, tuple(holes))


def test_a_short_training_reads_what_it_was_shown(tmp_path: Path) -> None:
    from bracket_lab.learned.holes.train import HoleTraining, train_holes

    plates = [drawn(seed) for seed in range(40)]
    out = tmp_path / "holes_plate.onnx"
    settings = HoleTraining(epochs=6, batch=4, widths=(8, 8, 16), hidden=16)
    scores = train_holes(plates, BENCH, PRODUCT, out, 0, settings)
    assert scores["validation_right"] > 0.9
    network = OnnxModel.load(out, "holes.plate")
    assert all(0.5 <= float(str(network.card.config[key])) < 1 for key in (LEAST_EMPTY, LEAST_FILLED))
    reader = HoleNetwork(BENCH, PRODUCT, network)
    readings = reader.read(reader.answer(plates[0].image, BENCH.overhead.mount.pose))
    said = {name: reading.part for name, reading in readings.items() if reading is not None}
    truth = {hole.position: hole.part for hole in plates[0].holes}
    assert said.items() <= truth.items()


def test_no_more_filled_holes_than_allowed_are_called_empty() -> None:
    from bracket_lab.learned.holes.train import LEAST_LEGAL, HoleTraining, least_sure

    rng = np.random.default_rng(0)
    truth = np.concatenate([np.zeros(500, np.int64), np.ones(1000, np.int64)])
    empty = np.concatenate([rng.uniform(0.9, 1.0, 500), rng.uniform(0.0, 0.96, 1000)]).astype(np.float32)
    shares = np.column_stack([empty, 1 - empty])
    for most in (0.0005, 0.002, 0.01):
        least = least_sure(shares, truth, truth >= 0, np.ones(1500), HoleTraining(most_called_empty=most))[LEAST_EMPTY]
        called_empty = (truth == 1) & (empty >= least) & (empty > 0.5)
        assert called_empty.mean() <= most
        assert least >= LEAST_LEGAL
    found = least_sure(np.array([[0.1, 0.9]], np.float32), np.array([1]), np.array([True]), np.ones(1), HoleTraining())
    assert set(found.values()) == {LEAST_LEGAL}


def test_probabilities_are_chosen_for_as_many_astray_parts_as_are_met_with() -> None:
    from bracket_lab.learned.holes.train import HoleTraining, as_met_with, least_sure

    rng = np.random.default_rng(1)
    truth = np.concatenate([np.zeros(1000, np.int64), np.ones(1000, np.int64)])
    seated = np.arange(2000) % 2 == 0  # half of the parts are astray, and of these one in ten is misnamed
    misnamed = (truth == 1) & ~seated & (rng.random(2000) < 0.1)
    sure = rng.uniform(0.4, 1.0, 2000)
    right, other = np.where(misnamed, 0.0, sure), np.where(misnamed, sure, 0.0)
    shares = np.column_stack([np.where(truth == 0, 1.0, 0.0), np.where(truth == 0, 0.0, right), other])
    weights = as_met_with(truth, seated, 0.15)
    assert weights[truth == 1][~seated[truth == 1]].sum() == pytest.approx(0.15 * 1000)
    assert weights[truth == 1][seated[truth == 1]].sum() == pytest.approx(0.85 * 1000)
    settings = HoleTraining()
    plain, met = (
        least_sure(shares.astype(np.float32), truth, truth >= 0, one, settings)[LEAST_FILLED]
        for one in (np.ones(2000), weights)
    )
    assert met < plain  # they are rarer than in the data: more may be said
    wrongly = misnamed & (sure >= met)
    assert weights[wrongly].sum() <= settings.most_misnamed * weights.sum()


def test_a_part_is_told_to_be_astray_as_seldom_as_parts_are() -> None:
    from bracket_lab.learned.holes.train import MISSED_COST, least_upright

    def plates(astray: int) -> list[Any]:
        return [SimpleNamespace(holes=[SimpleNamespace(part="o1", upright=index >= astray) for index in range(100)])]

    assert least_upright(plates(15), 0.15) == pytest.approx(MISSED_COST / (1 + MISSED_COST))
    told = least_upright(plates(40), 0.15)
    assert told / (1 - told) == pytest.approx(
        MISSED_COST * (0.15 / 0.85) / (0.4 / 0.6)
    )  # odds of what is astray, by Bayes' rule
    assert least_upright(plates(0), 0.15) == 0.5


def test_a_reader_that_is_sure_of_nothing_has_a_score_without_a_share_of_nothing() -> None:
    from bracket_lab.learned.holes.train import validation_scores

    said, right = np.array([True, True, False]), np.array([True, False, True])
    assert validation_scores(said, right) == pytest.approx({"validation_said": 2 / 3, "validation_right": 0.5})
    assert validation_scores(~said & said, right) == {"validation_said": 0.0}
    assert validation_scores(said[:0], right[:0]) == {"validation_said": 0.0}
