"""Scores of a semantic planner, whatever its kind: held-out scenarios, noise, calibration, unknown goals; no torch."""

from __future__ import annotations

from functools import cache

import numpy as np

from bracket_cell.learned.semantic.graph import EMPTY, Floats, Ints, Layout
from bracket_cell.learned.semantic.model import FactoredPlanner
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyPlan, SemanticPlanner
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.semantic.misdetection import Scenarios, misdetect
from bracket_lab.learned.semantic.paper_planner import PaperPlanner
from bracket_lab.learned.semantic.scenarios import (
    TRAIN_RATIO,
    Demonstrators,
    bound,
    consistent,
    from_the_right,
    runs,
    scenarios,
    split,
    unknown_goals,
)

RUNS = 1000  # random assemblies for everything that is measured under noise
ACTIONS = 5  # how many actions of each are looked at
THRESHOLDS = (0.0, 0.5, 0.8, 0.9, 0.95)  # of the posterior of the next (object, position)
LEAST_PROBABILITY = 1e-6  # of the true goal, so that one sure mistake does not make the mean log-likelihood infinite
CALIBRATION_BINS = 10


def evaluate_semantic(
    planner: SemanticPlanner, product: Product, seed: int, held_out: Scenarios | None = None
) -> dict[str, float]:
    """All scores by name, rates in 0..1: those on scenarios, and those under noise.

    Args:
        held_out: as for `evaluate_scenarios`.
    """
    answers = Answers(planner, Layout.of(product))
    scores = _on_scenarios(planner, answers, seed, held_out)
    return scores | under_noise(answers, answers.layout, np.random.default_rng([seed, 1]))


def evaluate_scenarios(
    planner: SemanticPlanner, product: Product, seed: int, held_out: Scenarios | None = None
) -> dict[str, float]:
    """Scores on every partial state and on those that training held out, by name, rates in 0..1.

    Args:
        held_out: states to score as held out. Without, learned planners are scored on the scenarios that their own
            training held out, and others on those that training with `seed` would hold out; planners that learned
            from a file of demonstrations have no such scenarios.
    """
    return _on_scenarios(planner, Answers(planner, Layout.of(product)), seed, held_out)


def _on_scenarios(
    planner: SemanticPlanner, answers: Answers, seed: int, held_out: Scenarios | None
) -> dict[str, float]:
    layout = answers.layout
    ratio, data_seed, source = _split_of(planner, seed)
    whole = scenarios(layout, data_seed)
    if held_out is None and not source:
        _, held_out = split(whole, ratio, data_seed)
    scores = {f"{name}_all": value for name, value in success(answers, layout, whole).items()}
    if held_out is not None:
        scores |= {f"{name}_held_out": value for name, value in success(answers, layout, held_out).items()}
    return scores


class Answers:
    """A planner's plans, each state asked for once."""

    def __init__(self, planner: SemanticPlanner, layout: Layout) -> None:
        self.layout = layout
        self._ask = cache(lambda row: planner.plan(layout.state(np.array(row))))

    def __call__(self, seen: Ints) -> AssemblyPlan:
        plan: AssemblyPlan = self._ask(tuple(seen.tolist()))
        return plan


def success(answers: Answers, layout: Layout, some: Scenarios) -> dict[str, float]:
    """Share of scenarios whose plan is right and complete for every object, beside the bound.

    Of the labelled goal (`success`), with the first missing object from the right as the next one, too
    (`strict_success`, the paper's rule), where only one goal fits (`unique_success`), of any goal that fits
    (`consistent_success`; its bound is 1).
    """
    fits = consistent(layout, some.seen)
    rights = np.array([_right_goals(answers(row), layout, row) for row in some.seen])
    labelled = rights[np.arange(len(some)), some.goals]
    unique = fits.sum(axis=1) == 1
    nexts = [answers(row).next_part for row in some.seen]
    rightmost = layout.types[some.goals, from_the_right(some).following]
    strict = [
        part is not None and layout.parts.index(part) == wanted for part, wanted in zip(nexts, rightmost, strict=True)
    ]
    return {
        "success": float(labelled.mean()),
        "strict_success": float((labelled & np.array(strict)).mean()),
        "bound": bound(layout, some),
        "unique_success": float(labelled[unique].mean()) if unique.any() else 1.0,
        "consistent_success": float((rights & fits).any(axis=1).mean()),
    }


def under_noise(answers: Answers, layout: Layout, rng: np.random.Generator) -> dict[str, float]:
    """Random assemblies seen with misdetections: goal accuracy by action, calibration, coverage, unknown goals."""
    depth = min(ACTIONS, len(layout.positions) - 1)
    demonstrators = Demonstrators(layout, np.zeros((1, *layout.types.shape)))
    true, steps = runs(demonstrators, RUNS, depth, rng)
    known = misdetect(layout, true, rng)
    plans = [answers(row) for row in known.seen]
    right = np.array([best_goal(plan, layout) for plan in plans]) == known.goals
    scores = {f"noisy_goal_accuracy_{k}": float(right[steps == k].mean()) for k in range(1, depth + 1)}
    scores |= calibration(plans, layout, known)
    scores |= coverage(plans, layout, known, true)
    others = misdetect(layout, unknown_goals(layout, known.seen != EMPTY, rng), rng)
    if len(others):
        strange = np.array([_strangeness(answers(row)) for row in others.seen])
        usual = np.array([_strangeness(plan) for plan in plans])
        scores |= {
            f"unknown_goal_auc_{k}": area_under_roc(strange[steps[: len(others)] == k], usual[steps == k])
            for k in range(1, depth + 1)
        }
    return scores


def calibration(plans: list[AssemblyPlan], layout: Layout, known: Scenarios) -> dict[str, float]:
    """Mean negative log-likelihood of the true goal [nat] and expected calibration error of the best one."""
    belief = np.array([[plan.goal_belief[goal] for goal in layout.goals] for plan in plans])
    true = belief[np.arange(len(plans)), known.goals]
    best, right = belief.max(axis=1), belief.argmax(axis=1) == known.goals
    bins = np.minimum((best * CALIBRATION_BINS).astype(int), CALIBRATION_BINS - 1)
    gaps = [abs(float((best - right)[bins == i].sum())) for i in range(CALIBRATION_BINS)]
    return {
        "goal_nll": float(-np.log(np.maximum(true, LEAST_PROBABILITY)).mean()),
        "goal_calibration_error": sum(gaps) / len(plans),
    }


def coverage(plans: list[AssemblyPlan], layout: Layout, known: Scenarios, true: Scenarios) -> dict[str, float]:
    """How often the best (object, position) reaches a threshold, and how often it is wrong where it does.

    `wrong_at` is the wrong type for its position; `blocked_at`: of all acts, those into a hole that is truly filled.

    Args:
        known: the states as they were reported.
        true: the same states as they are.
    """
    believed, wrong, blocked = [], [], []
    for plan, goal, filled in zip(plans, known.goals, true.seen != EMPTY, strict=True):
        (part, position), belief = max(plan.next_belief.items(), key=lambda item: item[1], default=(("", ""), 0.0))
        believed.append(belief)
        truth = layout.types[goal, layout.positions.index(position)] if position else EMPTY
        wrong.append(not part or layout.parts[int(truth)] != part)
        blocked.append(bool(position) and bool(filled[layout.positions.index(position)]))
    reached = np.array(believed)[:, None] >= np.array(THRESHOLDS)
    acted = np.maximum(reached.sum(axis=0), 1)
    rates = {
        "coverage": reached.mean(axis=0),
        "wrong": (reached & np.array(wrong)[:, None]).sum(axis=0) / acted,
        "blocked": (reached & np.array(blocked)[:, None]).sum(axis=0) / acted,
    }
    return {
        f"{name}_at_{t}": float(value) for name, row in rates.items() for t, value in zip(THRESHOLDS, row, strict=True)
    }


def area_under_roc(positive: Floats, negative: Floats) -> float:
    """Probability that a positive scores above a negative, ties counting half."""
    difference = np.asarray(positive)[:, None] - np.asarray(negative)
    return float(((difference > 0) + 0.5 * (difference == 0)).mean())


def _split_of(planner: SemanticPlanner, seed: int) -> tuple[float, int, str]:
    """Ratio and seed of the split, and the file that was learned from, empty for generated scenarios."""
    if not isinstance(planner, PaperPlanner | FactoredPlanner):
        return TRAIN_RATIO, seed, ""
    ratio = planner.card.config["ratio"]
    assert isinstance(ratio, float), f"model card with ratio {ratio!r}"
    return ratio, planner.card.seed, str(planner.card.config.get("data", ""))


def _right_goals(plan: AssemblyPlan, layout: Layout, seen: Ints) -> list[bool]:
    """For every goal: the guidance is its plan exactly, and the next object is one of those that remain."""
    open_positions = [i for i, part in enumerate(seen) if part == EMPTY]
    rights = []
    for types in layout.types:
        wanted = {
            part: tuple(layout.positions[i] for i in open_positions if layout.parts[types[i]] == part)
            for part in layout.parts
        }
        remains = plan.next_part is not None and bool(wanted[plan.next_part])
        rights.append(remains and dict(plan.guidance) == wanted)
    return rights


def best_goal(plan: AssemblyPlan, layout: Layout) -> int:
    """Index of the most probable of the demonstrated goals."""
    return int(np.argmax([plan.goal_belief[goal] for goal in layout.goals]))


def _strangeness(plan: AssemblyPlan) -> float:
    """Score for "none of these": its probability, or where a planner has none, doubt in the best goal."""
    return plan.goal_belief.get(UNKNOWN_GOAL, 1.0 - max(plan.goal_belief.values()))
