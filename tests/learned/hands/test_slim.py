"""The shipped weights of the small tracker find hands that they were not trained on."""

from pathlib import Path

import pytest

from cell.configuration import load_configuration, load_product, simulated
from cell.evaluating.hands import ONLY, evaluate_hands
from cell.interfaces.errors import ModelError
from cell.interfaces.planning import weights_file
from cell.settings import WEIGHTS
from learned.hands.slim import finder_file, slim_tracker

FILE = WEIGHTS / weights_file("hands", "slim")
MOST_BYTES = 2_000_000
SEED = 900_012


@pytest.mark.parametrize("look", ["nominal", "varied"])
def test_hands_are_found_read_and_told_apart(look: str) -> None:
    configuration = simulated(load_configuration(), look, "varied")
    product = load_product(configuration)
    trackers = {"slim": lambda: slim_tracker(configuration.bench, product, FILE)}
    scores = evaluate_hands(configuration, product, trackers, [SEED], stretches=2, physics=False)["slim"]
    assert scores["found_n"] > 20
    assert scores["found"] > 0.95
    assert scores["palm_image_mm_p95"] < 15
    assert scores["forearm_deg_p95"] < 15
    assert scores["others_imagined"] < 0.1


def test_most_hands_are_found_in_looks_beyond_those_of_training() -> None:
    configuration = simulated(load_configuration(), "hard", "varied")
    product = load_product(configuration)
    trackers = {"slim": lambda: slim_tracker(configuration.bench, product, FILE)}
    scores = evaluate_hands(configuration, product, trackers, [SEED], stretches=2, physics=False)["slim"]
    assert scores["found"] > 0.7


def test_the_other_hand_is_not_the_one_that_works() -> None:
    configuration = simulated(load_configuration(), "nominal", "varied")
    product = load_product(configuration)
    trackers = {"slim": lambda: slim_tracker(configuration.bench, product, FILE)}
    scores = evaluate_hands(configuration, product, trackers, [SEED], stretches=2, physics=False, only="second")["slim"]
    assert scores["found"] > 0.95
    assert scores["second_found"] > 0.9


def test_the_weights_are_small_and_both_are_needed(tmp_path: Path) -> None:
    assert FILE.stat().st_size + finder_file(FILE).stat().st_size < MOST_BYTES
    configuration = load_configuration()
    (tmp_path / FILE.name).write_bytes(FILE.read_bytes())
    with pytest.raises(ModelError, match="slim_finder"):
        slim_tracker(configuration.bench, load_product(configuration), tmp_path / FILE.name)


def test_every_choice_of_persons_is_a_part_of_a_look() -> None:
    person = load_configuration().devices.simulation.look.low.person
    for choose in ONLY.values():
        for seed in range(12):
            assert set(choose(seed)) <= set(type(person).model_fields)
    assert len({choose["glove_hsv"] for choose in map(ONLY["gloves"], range(24))}) == 12
