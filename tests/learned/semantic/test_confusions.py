"""Confusions of the action detector: exact likelihoods, learning from confirmed actions, and what planners gain."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from itertools import permutations
from math import comb
from pathlib import Path

import numpy as np
import pytest

from bracket_cell.commands.main import main
from bracket_cell.learned.semantic.confusions import (
    PATTERNS,
    ConfusionLikelihood,
    Confusions,
    Reports,
    confirmed_reports,
)
from bracket_cell.learned.semantic.graph import EMPTY, Layout, one_hot
from bracket_cell.learned.semantic.posterior import BayesPosterior, Noise, UniformLikelihood
from bracket_ground.errors import InputError
from bracket_ground.files.files import shipped
from bracket_ground.interfaces.planning import AssemblyState
from bracket_lab.learned.semantic.evaluate import Answers, coverage
from bracket_lab.learned.semantic.misdetection import Scenarios, misdetect
from bracket_lab.learned.semantic.paper_planner import load_semantic_planner
from bracket_lab.learned.semantic.scenarios import sampled, scenarios
from tests.learned.products import DEFAULT

LAYOUT = Layout.of(DEFAULT)
WEIGHTS = Path("learned/weights/semantic_factored.onnx")


def reports(pattern: str, count: int, error: float, seed: int) -> Iterator[tuple[tuple[str, str], tuple[str, str]]]:
    """Actions as they were and as they were reported."""
    rng = np.random.default_rng(seed)
    matrix = Confusions.of(LAYOUT, pattern, error).matrix  # type: ignore[arg-type]
    for _ in range(count):
        goal, position = rng.integers(3), rng.integers(6)
        true = int(LAYOUT.types[goal, position]) * 6 + int(position)
        reported = int(rng.choice(18, p=matrix[true]))
        names = [(LAYOUT.parts[action // 6], LAYOUT.positions[action % 6]) for action in (true, reported)]
        yield names[0], names[1]


@pytest.mark.parametrize("pattern", PATTERNS)
def test_rows_are_distributions_with_the_given_error(pattern: str) -> None:
    confusions = Confusions.of(LAYOUT, pattern, 0.1)  # type: ignore[arg-type]
    assert np.allclose(confusions.matrix.sum(axis=1), 1.0)
    assert np.allclose(np.diag(confusions.matrix), 0.9)
    assert confusions.error == pytest.approx(0.1)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_the_likelihood_is_that_of_listing_all_ways(pattern: str) -> None:
    confusions = Confusions.of(LAYOUT, pattern, 0.2)  # type: ignore[arg-type]
    likelihood = ConfusionLikelihood(LAYOUT, confusions)
    for seen in ([(0, 0)], [(1, 1), (0, 2)], [(0, 0), (0, 1), (2, 5)], [(2, 0), (1, 3), (0, 4), (0, 5)]):
        edges = np.zeros((3, 6), np.float32)
        edges[tuple(zip(*seen, strict=True))] = 1.0
        found, still_open = likelihood(edges)
        _, chances = Reports(confusions, 6).chances(edges)
        chance = chances.reshape(len(seen), 3, 6)[:, LAYOUT.types, np.arange(6)]
        total, opened = np.zeros(3), np.zeros((3, 6))
        for slots in permutations(range(6), len(seen)):
            share = np.prod([chance[r, :, slot] for r, slot in enumerate(slots)], axis=0) / comb(6, len(seen))
            total += share
            opened += share[:, None] * np.array([slot not in slots for slot in range(6)])
        assert np.allclose(found, total)
        assert np.allclose(still_open, opened)


def test_a_detectors_table_tells_what_it_takes_for_what() -> None:
    classes = ["o1 at p1", "o2 at p1", "screw"]
    found = Confusions.counted(LAYOUT, classes, [[90, 10, 3], [0, 100, 0], [5, 0, 80]])
    assert found.matrix[LAYOUT.parts.index("o1") * 6, LAYOUT.parts.index("o2") * 6] == pytest.approx(0.1, abs=0.03)
    assert found.matrix[LAYOUT.parts.index("o2") * 6, LAYOUT.parts.index("o1") * 6] < 0.02
    assert np.allclose(found.matrix.sum(axis=1), 1)


def test_a_detector_in_doubt_counts_as_the_mean_of_what_it_may_have_seen() -> None:
    confusions = Confusions.of(LAYOUT, "uniform", 0.05)
    sure, other = (AssemblyState({"p1": LAYOUT.parts[0], "p2": part}) for part in LAYOUT.parts[:2])
    likelihood = ConfusionLikelihood(LAYOUT, confusions)
    doubt = replace(sure, doubts={"p2": {LAYOUT.parts[0]: 0.6, LAYOUT.parts[1]: 0.4}})
    found = likelihood(LAYOUT.doubted(doubt))[0]
    apart = [likelihood(LAYOUT.encode(state))[0] for state in (sure, other)]
    assert np.allclose(found, 0.6 * apart[0] + 0.4 * apart[1], rtol=2e-3)
    for kind in ("bayes", "factored"):
        planner = load_semantic_planner(kind, WEIGHTS, DEFAULT, confusions=confusions)
        belief, doubted = (max(planner.plan(state).goal_belief.values()) for state in (sure, doubt))
        assert doubted < belief or belief < 0.5


def test_uniform_confusions_are_nearly_the_closed_form() -> None:
    listed = ConfusionLikelihood(LAYOUT, Confusions.of(LAYOUT, "uniform", 0.05))
    closed = UniformLikelihood(LAYOUT, Noise.of(LAYOUT, 0.05))
    for edges in one_hot(misdetect(LAYOUT, scenarios(LAYOUT, 0), np.random.default_rng(0), 0.1).seen, 3):
        one, other = listed(edges)[0], closed(edges)[0]
        assert np.abs(one / one.sum() - other / other.sum()).max() < 0.1


@pytest.mark.parametrize("pattern", PATTERNS)
def test_drawn_misdetections_follow_the_matrix(pattern: str) -> None:
    matrix = Confusions.of(LAYOUT, pattern, 0.3).matrix  # type: ignore[arg-type]
    true = np.full((3000, 6), EMPTY)
    true[:, 2] = LAYOUT.types[0, 2]
    seen = misdetect(
        LAYOUT,
        Scenarios(np.zeros(3000, int), true, np.zeros(3000, int)),
        np.random.default_rng(0),
        confusions=matrix,
    ).seen
    counts = np.zeros(18)
    for row in seen:
        position = int(np.flatnonzero(row != EMPTY)[0])
        counts[row[position] * 6 + position] += 1
    assert np.allclose(counts / 3000, matrix[LAYOUT.types[0, 2] * 6 + 2], atol=0.03)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_the_matrix_is_learned_from_confirmed_actions(pattern: str) -> None:
    truth = Confusions.of(LAYOUT, pattern, 0.1).matrix  # type: ignore[arg-type]
    learned = Confusions.learned(LAYOUT, list(reports(pattern, 1500, 0.1, 1)))
    known = [part * 6 + position for row in LAYOUT.types for position, part in enumerate(row)]
    wrong = np.abs(learned.matrix - truth)[known]
    nothing = np.abs(Confusions.of(LAYOUT, "uniform", 0.045).matrix - truth)[known]
    assert np.allclose(learned.matrix.sum(axis=1), 1.0)
    assert wrong.sum() < (1.0 if pattern == "uniform" else 0.6) * nothing.sum()
    assert learned.error == pytest.approx(0.1, abs=0.03)


def test_what_is_written_is_read(tmp_path: Path) -> None:
    learned = Confusions.learned(LAYOUT, list(reports("alike types", 200, 0.1, 2)))
    learned.save(tmp_path / "confusions.json", LAYOUT, 200, "a test")
    assert np.allclose(Confusions.load(tmp_path / "confusions.json", LAYOUT).matrix, learned.matrix, atol=1e-5)
    (tmp_path / "confusions.json").write_text("{}")
    with pytest.raises(InputError, match="no confusions of actions"):
        Confusions.load(tmp_path / "confusions.json", LAYOUT)
    with pytest.raises(InputError, match="no confusions of actions"):
        Confusions.load(tmp_path / "nowhere.json", LAYOUT)


@pytest.mark.parametrize("kind", ["factored", "bayes"])
def test_a_learned_matrix_makes_planners_err_less(kind: str) -> None:
    rng = np.random.default_rng(5)
    true = sampled(LAYOUT, 1500, rng)
    matrix = Confusions.of(LAYOUT, "alike types", 0.1)
    seen = misdetect(LAYOUT, true, rng, confusions=matrix.matrix)
    held = Scenarios(seen.goals, np.where(true.seen == EMPTY, EMPTY, seen.seen), seen.following)
    learned = Confusions.learned(LAYOUT, list(reports("alike types", 600, 0.1, 3)))
    wrong = []
    for confusions in (None, learned):
        answers = Answers(load_semantic_planner(kind, WEIGHTS, DEFAULT, None, confusions), LAYOUT)
        plans = [answers(row) for row in held.seen]
        wrong.append(coverage(plans, LAYOUT, held, true)["wrong_at_0.9"])
    assert 0.0 < wrong[1] < 0.6 * wrong[0]


def test_no_noise_at_all_is_no_confusion() -> None:
    posterior = BayesPosterior(LAYOUT, confusions=Confusions.of(LAYOUT, "uniform", 0.0))
    assert posterior(one_hot(LAYOUT.types[0], 3)).belief[0] > 0.99


def segment(part: str, hole: str, found: str | None, holes: dict[str, str | None], log: str = "a") -> dict[str, object]:
    confirmed = {"part": found, "position": hole, "seen_s": 1.0, "agrees": found == part}
    detected = {"kind": "assembly", "part": part, "position": hole, "finished": True}
    return {"log": log, "detected": detected, "confirmed": confirmed, "holes": holes}


def test_confirmed_actions_are_read_from_segments_and_train_the_noise(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = [
        {"format": "cell.segments", "version": 1, "source": "a test"},
        segment("o1", "p1", "o1", {"p1": None}),
        segment("o1", "p1", "o1", {"p1": "o1"}),  # the same action, a second later
        segment("o2", "p2", "o1", {"p1": "o1", "p2": None}),  # another type
        segment("o2", "p4", None, {"p1": "o1", "p2": "o1", "p4": None}),  # another hole: p5, as the next row shows
        segment("o3", "p6", "o3", {"p1": "o1", "p2": "o1", "p5": "o2", "p6": None}),
        segment("o3", "p3", None, {"p3": None}),  # nobody knows
    ]
    path = tmp_path / "segments.jsonl"
    path.write_text("".join(json.dumps(row) + "\n" for row in rows))
    assert confirmed_reports(path) == [
        (("o1", "p1"), ("o1", "p1")),
        (("o1", "p2"), ("o2", "p2")),
        (("o2", "p5"), ("o2", "p4")),
        (("o3", "p6"), ("o3", "p6")),
    ]
    out = tmp_path / "confusions.json"
    config = tmp_path / "config" / "cell.yaml"
    config.parent.mkdir()
    for name in ("cell.yaml", "sim.yaml", "products.yaml"):
        (config.parent / name).write_text(shipped("bracket_cell.config", name).read_text())
    assert main(["lab", "train", "noise", "--data", str(path), "--out", str(out), "--config", str(config)]) == 0
    told = "".join(capsys.readouterr().err.split())
    assert told.endswith("planners.semantic.confusions:../confusions.json")  # as a path in that file
    assert json.loads(out.read_text())["reports_n"] == 4
    out.write_text("mine")
    words = ["lab", "train", "noise", "--data", str(path), "--out", str(out), "--config", str(config)]
    assert main(words) == 2
    assert "confusions.json: exists already; choose another --out, or add --overwrite" in capsys.readouterr().err
    assert out.read_text() == "mine"
    assert main([*words, "--overwrite"]) == 0
    trained = tmp_path / "trained"
    words = ["train", "--only", "noise", "--out", str(trained), "--config", str(config)]
    assert main(words) == 2
    assert "--recorded DIR" in capsys.readouterr().err
    assert main([*words, "--recorded", str(tmp_path)]) == 0
    assert json.loads((trained / "confusions.json").read_text())["reports_n"] == 4
    assert main([*words, "--recorded", str(tmp_path), "--plan"]) == 0
    assert "made before" in capsys.readouterr().err
    path.write_text('{"format": "cell.crops"}\n')
    with pytest.raises(InputError, match=r"segments\.jsonl:1: no file of segments"):
        confirmed_reports(path)
