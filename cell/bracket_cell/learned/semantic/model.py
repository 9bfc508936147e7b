"""Semantic planners at run time: an assembly state in, belief and plans out; numpy and onnxruntime, no torch."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bracket_cell.learned.inference.onnx_model import ModelCard, Network, OnnxModel
from bracket_cell.learned.semantic.confusions import Confusions
from bracket_cell.learned.semantic.goals import OpenGoals
from bracket_cell.learned.semantic.graph import Floats, Layout
from bracket_cell.learned.semantic.posterior import (
    BayesPosterior,
    Likelihood,
    Noise,
    Posterior,
    UniformLikelihood,
    UnknownGoal,
    approximations,
    confusion_likelihood,
    posterior,
)
from bracket_cell.learned.semantic.settings import DETECTION_ERROR
from bracket_ground.errors import ModelError
from bracket_ground.interfaces.planning import UNKNOWN_GOAL, AssemblyPlan, AssemblyState
from bracket_ground.interfaces.product import Product

FACTORED_OUTPUTS = ("goals", "still_open", "wanted", "prior", "usual", "following")
LEAST_BELIEF = 1e-9  # placements believed less are left out of the answer
SURE = 0.9  # placements of a goal that nobody knows are planned from this probability on


@dataclass(frozen=True, eq=False)
class Answer:
    """What any planner finds, by index.

    Attributes:
        belief: (z,) or, with the probability that it is none of them, (z + 1,).
        placements: (n, m) probability that a type is right at an open position.
        following: (n,) how probable each type is as the next one.
        guidance: by type, the positions that still want it.
    """

    belief: Floats
    placements: Floats
    following: Floats
    guidance: dict[str, tuple[str, ...]]


def load_semantic_planner(
    kind: str, weights: Path, product: Product, goals: OpenGoals | None = None, confusions: Confusions | None = None
) -> FactoredPlanner | BayesPlanner:
    """The planner of a file of weights.

    Args:
        kind: "factored", or "auto": that where the weights are of this product, else `BayesPlanner`, which is as good
            where nobody's habits were recorded, and knows families.
        weights: from `cell train --only semantic`.
        goals: learned beside the product's own.
        confusions: what the action detector takes for what.

    Raises:
        ModelError: the weights are missing, damaged, of another kind, trained for another product, or cannot answer.
    """
    model, wanted = OnnxModel.load(weights, "semantic.factored"), Layout.of(product).vocabulary
    if kind == "auto" and (product.varies or model.card.vocabulary != wanted):
        return BayesPlanner(product, goals, confusions)
    for use, words in wanted.items():
        model.require_vocabulary(use, words)
    planner = FactoredPlanner(product, model, goals, confusions)
    planner.plan(AssemblyState({}))  # weights that cannot answer at all fail here, before anything moves
    return planner


class BayesPlanner:
    """The rule-based reference: exact posterior under a noise model, plans read from the product's goals."""

    def __init__(self, product: Product, goals: OpenGoals | None = None, confusions: Confusions | None = None) -> None:
        goals = goals or OpenGoals.of(product)
        self.layout = Layout.of(goals.product)
        self._product = product
        *known, none = goals.prior()
        self._posterior = BayesPosterior(
            self.layout, unknown=none, prior=np.array(known) / sum(known), confusions=confusions
        )

    def with_goals(self, goals: OpenGoals, confusions: Confusions | None = None) -> BayesPlanner:
        """The same with other goals learned beside the product's own."""
        return BayesPlanner(self._product, goals, confusions)

    def plan(self, state: AssemblyState) -> AssemblyPlan:
        layout, edges = self.layout, self.layout.encode(state)
        found = as_told(self._posterior(edges, layout.doubted(state)), layout, edges, state.told_goal)
        plan = assembly_plan(layout, edges, _answer(layout, edges, found, layout.wanted, _by_quantity(layout, edges)))
        return replace(plan, inference=self.inference)

    @property
    def inference(self) -> str:
        """How goals are inferred: "exact", or what of it is approximate."""
        return inference_by(self._posterior.approximate)


def inference_by(approximate: str) -> str:
    """For the log: "exact", or what of the inference is approximate, and why."""
    return f"approximate: {approximate}" if approximate else "exact"


class LearnedPlanner:
    """Base of the planners whose answers come from a network."""

    def __init__(self, product: Product, model: Network) -> None:
        self.layout = Layout.of(product)
        self._model = model

    @property
    def card(self) -> ModelCard:
        """Where the weights come from."""
        return self._model.card


class FactoredPlanner(LearnedPlanner):
    """Learned slots and habits with exact inference under noise; guidance is a template over the slots."""

    def __init__(
        self, product: Product, model: Network, goals: OpenGoals | None = None, confusions: Confusions | None = None
    ) -> None:
        super().__init__(product, model)
        goals = goals or OpenGoals.of(product)
        error = model.card.config.get("error", DETECTION_ERROR)
        if not isinstance(error, float):
            raise ModelError(f"{model.path}: the card's error rate is {error!r}, not a number")
        if missing := set(FACTORED_OUTPUTS) - set(model.outputs):
            raise ModelError(f"{model.path}: has no outputs {sorted(missing)}; again: cell train --only semantic")
        noise = Noise.of(self.layout, error)
        self._product, self._goals = product, goals
        self.layout = Layout.of(goals.product)
        self._unknown = UnknownGoal(self.layout, noise)
        self._uniform = UniformLikelihood(self.layout, noise)
        self._counted = None if confusions is None else confusion_likelihood(self.layout, confusions)

    def plan(self, state: AssemblyState) -> AssemblyPlan:
        layout, edges = self.layout, self.layout.encode(state)
        found = self._model.run({"edges": edges})
        *known, none = self._goals.prior(found["prior"])
        alike = self._with_learned(edges, found, np.array(known) / sum(known))
        if self._counted is None:
            believed = posterior(edges, alike, self._unknown, none)
        else:
            believed = posterior(edges, self._confused(edges, layout.doubted(state), alike), self._unknown, none, alike)
        following = _by_quantity(layout, edges)
        following[: len(found["goals"])] = found["following"]
        believed = as_told(believed, layout, edges, state.told_goal)
        plan = assembly_plan(layout, edges, _answer(layout, edges, believed, alike.wanted, following))
        return replace(plan, inference=inference_by(approximations(layout.hypotheses, self._counted)))

    def with_goals(self, goals: OpenGoals, confusions: Confusions | None = None) -> FactoredPlanner:
        """The same network with other goals learned beside its own."""
        return FactoredPlanner(self._product, self._model, goals, confusions)

    def _with_learned(self, edges: Floats, found: Mapping[str, Floats], prior: Floats) -> Likelihood:
        """The network's likelihoods, and beside them those of learned goals: people have no habits in these yet."""
        trained, usual = len(found["goals"]), float(found["usual"])
        goals, still_open = (values[trained:] * usual for values in self._uniform(edges))
        return Likelihood(
            np.concatenate([found["goals"], goals]),
            np.concatenate([found["still_open"], still_open]),
            np.concatenate([found["wanted"], self.layout.wanted[trained:]]),
            prior,
            usual,
        )

    def _confused(self, edges: Floats, seen: Floats, alike: Likelihood) -> Likelihood:
        """The same under confusions: habits and noise are taken as independent, so that the ratio of noises counts."""
        assert self._counted is not None
        counted, uniform = self._counted(seen), self._uniform(edges)
        goals, still_open = (some / np.maximum(other, 1e-300) for some, other in zip(counted, uniform, strict=True))
        return replace(alike, goals=alike.goals * goals, still_open=alike.still_open * still_open)


def _answer(layout: Layout, edges: Floats, found: Posterior, wanted: Floats, following: Floats) -> Answer:
    """A posterior with the plans of its most probable goal; `wanted` (z, n, m), `following` (z, n).

    Where that is none of the known ones, only placements are named that are sure: the last ones, by what remains.
    """
    goals = found.belief[: len(layout.goals)]
    likeliest = int(np.argmax(found.belief))
    if likeliest == len(layout.goals):
        guidance = templated_guidance(layout, edges, np.where(found.placements > SURE, found.placements, 0.0))
    elif layout.hypotheses.plain:
        guidance = templated_guidance(layout, edges, wanted[likeliest])
    else:
        guidance = layout.places(likeliest, edges)
    return Answer(found.belief, found.placements, goals @ following, guidance)


def as_told(found: Posterior, layout: Layout, edges: Floats, goal: str | None) -> Posterior:
    """The posterior after the person named the goal; unchanged where nobody did, or where it is none that is known.

    What "none of these" wants is unknown: any type as far as its quantity goes.
    """
    if goal is None or goal not in (*layout.goals, UNKNOWN_GOAL):
        return found
    still = 1.0 - edges.any(axis=0)
    if goal == UNKNOWN_GOAL:
        left = np.maximum(layout.quantities - edges.sum(axis=1), 0.0)
        return Posterior(np.eye(len(layout.goals) + 1)[-1], np.outer(left / max(left.sum(), 1.0), still))
    number = layout.goals.index(goal)
    return Posterior(np.eye(len(layout.goals) + 1)[number], layout.wanted[number] * still)


def _by_quantity(layout: Layout, edges: Floats) -> Floats:
    """(z, n) share of the types in what each goal still wants."""
    still = layout.wanted * (1.0 - edges.sum(axis=0))
    shares: Floats = still.sum(axis=2) / np.maximum(still.sum(axis=(1, 2)), 1.0)[:, None]
    return shares


def templated_guidance(layout: Layout, edges: Floats, wanted: Floats) -> dict[str, tuple[str, ...]]:
    """Guidance of one goal that wants (n, m): by type, the open positions that want it most, in order."""
    types = wanted.argmax(axis=0)
    still = np.flatnonzero((edges.sum(axis=0) == 0) & wanted.any(axis=0)).tolist()
    return {
        name: tuple(layout.positions[i] for i in still if types[i] == part) for part, name in enumerate(layout.parts)
    }


def assembly_plan(layout: Layout, edges: Floats, answer: Answer) -> AssemblyPlan:
    """An answer by names.

    Raises:
        ModelError: the belief is no distribution.
    """
    belief = answer.belief / answer.belief.sum()
    if not np.isfinite(belief).all():
        raise ModelError(f"belief over goals is {answer.belief.tolist()}, not a distribution")
    return AssemblyPlan(
        goal_belief=dict(zip((*layout.goals, UNKNOWN_GOAL), belief.tolist(), strict=False)),
        next_belief={
            (layout.parts[part], layout.positions[position]): float(answer.placements[part, position])
            for part, position in np.argwhere(answer.placements > LEAST_BELIEF)
        },
        next_part=_next_part(layout, edges, answer),
        guidance=answer.guidance,
    )


def _next_part(layout: Layout, edges: Floats, answer: Answer) -> str | None:
    """The most probable type of those that remain: by quantity, unless that rules out all that is still wanted."""
    if edges.any(axis=0).all():
        return None
    left = edges.sum(axis=1) < layout.quantities
    wanted = answer.placements.sum(axis=1) > LEAST_BELIEF
    candidates = next((some for some in (wanted & left, wanted, left) if some.any()), None)
    if candidates is None:
        return None
    return layout.parts[int(np.argmax(np.where(candidates, answer.following, -1.0)))]
