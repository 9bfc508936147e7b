"""Semantic planners at run time: an assembly state in, belief and plans out; numpy and onnxruntime, no torch."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from cell.interfaces.errors import InputError, ModelError
from cell.interfaces.planning import UNKNOWN_GOAL, AssemblyPlan, AssemblyState, SemanticPlanner
from cell.interfaces.product import Product
from learned.onnx_model import ModelCard, Network, OnnxModel
from learned.semantic.and_or import AndOrGraph
from learned.semantic.bayes import BayesPosterior
from learned.semantic.graph import EMPTY, Floats, Ints, Layout
from learned.semantic.noise import Noise
from learned.semantic.posterior import Likelihood, Posterior, UnknownGoal, posterior
from learned.semantic.scenarios import DETECTION_ERROR

SemanticKind = Literal["paper", "factored", "and_or", "bayes"]
FACTORED_OUTPUTS = ("goals", "still_open", "wanted", "prior", "usual", "following")
LEAST_BELIEF = 1e-9  # placements believed less are left out of the answer


@dataclass(frozen=True)
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


def load_semantic_planner(kind: str, path: Path | None, product: Product) -> SemanticPlanner:
    """The planner that the configuration names.

    Args:
        kind: "paper", "factored", "and_or", or "bayes", which has no weights and ignores `path`.
        path: weights from `cell train semantic`.

    Raises:
        InputError: no such kind.
        ModelError: the weights are missing, damaged, of another kind, trained for another product, or cannot answer.
    """
    if kind == "bayes":
        return BayesPlanner(product)
    if kind not in get_args(SemanticKind):
        raise InputError(f"no semantic planner {kind!r}; there are {', '.join(get_args(SemanticKind))}")
    if path is None:
        raise InputError(f"the semantic planner {kind!r} needs a weights file (make one with `cell train semantic`)")
    if kind == "and_or":
        return AndOrPlanner(product, AndOrGraph.load(path, Layout.of(product)))
    model = OnnxModel.load(path, f"semantic.{kind}")
    for use, words in Layout.of(product).vocabulary.items():
        model.require_vocabulary(use, words)
    planner: SemanticPlanner = PaperPlanner(product, model) if kind == "paper" else FactoredPlanner(product, model)
    planner.plan(AssemblyState({}))  # weights that cannot answer at all fail here, before anything moves
    return planner


class BayesPlanner:
    """The rule-based reference: exact posterior under a noise model, plans read from the product's goals."""

    def __init__(self, product: Product) -> None:
        self._layout = Layout.of(product)
        self._posterior = BayesPosterior(self._layout)

    def plan(self, state: AssemblyState) -> AssemblyPlan:
        edges = self._layout.encode(state)
        still = self._layout.wanted * (1.0 - edges.sum(axis=0))
        following = still.sum(axis=2) / np.maximum(still.sum(axis=(1, 2)), 1.0)[:, None]
        found = self._posterior(edges)
        return _assemble(self._layout, edges, _answer(self._layout, edges, found, self._layout.wanted, following))


class AndOrPlanner:
    """Looks the state up in an AND/OR graph; outside the graph it names no goal and proposes nothing."""

    def __init__(self, product: Product, graph: AndOrGraph) -> None:
        self._layout = Layout.of(product)
        self._graph = graph

    @property
    def card(self) -> ModelCard:
        """Where the graph comes from."""
        return self._graph.card

    def plan(self, state: AssemblyState) -> AssemblyPlan:
        layout, edges = self._layout, self._layout.encode(state)
        node = self._graph.node(np.where(edges.any(axis=0), edges.argmax(axis=0), EMPTY))
        if node is None:
            belief = dict.fromkeys(layout.goals, 0.0) | {UNKNOWN_GOAL: 1.0}
            return AssemblyPlan(belief, {}, None, dict.fromkeys(layout.parts, ()))
        goals = self._graph.belief(node)
        placements = np.tensordot(goals, layout.wanted, 1) * (1.0 - edges.any(axis=0))
        guidance = _templated(layout, edges, layout.wanted[int(np.argmax(goals))])
        belief_and_none = np.append(goals, 0.0)
        return _assemble(layout, edges, Answer(belief_and_none, placements, self._graph.following(node), guidance))


class LearnedPlanner:
    """Base of the planners whose answers come from a network."""

    def __init__(self, product: Product, model: Network) -> None:
        self._layout = Layout.of(product)
        self._model = model

    @property
    def card(self) -> ModelCard:
        """Where the weights come from."""
        return self._model.card


class FactoredPlanner(LearnedPlanner):
    """Learned slots and habits with exact inference under noise; guidance is a template over the slots."""

    def __init__(self, product: Product, model: Network) -> None:
        super().__init__(product, model)
        error = model.card.config.get("error", DETECTION_ERROR)
        if not isinstance(error, float):
            raise ModelError(f"{model.path}: the card's error rate is {error!r}, not a number")
        if missing := set(FACTORED_OUTPUTS) - set(model.outputs):
            raise ModelError(f"{model.path}: has no outputs {sorted(missing)}; train it again (cell train semantic)")
        self._unknown = UnknownGoal(self._layout, Noise.of(self._layout, error))

    def plan(self, state: AssemblyState) -> AssemblyPlan:
        edges = self._layout.encode(state)
        found = self._model.run({"edges": edges})
        likelihood = Likelihood(
            found["goals"], found["still_open"], found["wanted"], found["prior"], float(found["usual"])
        )
        believed = posterior(edges, likelihood, self._unknown)
        return _assemble(
            self._layout, edges, _answer(self._layout, edges, believed, found["wanted"], found["following"])
        )


class PaperPlanner(LearnedPlanner):
    """The paper's graph network and LSTM decoder; plans are decoded once for every goal and mixed by belief."""

    def plan(self, state: AssemblyState) -> AssemblyPlan:
        edges = self._layout.encode(state)
        found = self._model.run({"edges": edges})
        belief, words = found["belief"], found["words"]
        placements = np.tensordot(belief, wanted_by_words(self._layout, words), 1) * (1.0 - edges.any(axis=0))
        guidance = _read(self._layout, words[int(np.argmax(belief))])
        return _assemble(self._layout, edges, Answer(belief, placements, belief @ found["following"], guidance))


def wanted_by_words(layout: Layout, words: Ints) -> Floats:
    """(z, n, m) from decoded words (z, n, T): one where a plan names a position before its end.

    Plans are decoded object by object; a position that several of a goal's plans name is shared among them.
    """
    goals, parts, _ = words.shape
    saying = (words != len(layout.words) - 1).cumprod(axis=2).astype(bool)
    wanted = np.zeros((goals, parts, len(layout.words)), np.float32)
    goal, part, step = np.nonzero(saying)
    wanted[goal, part, words[goal, part, step]] = 1.0
    wanted = wanted[:, :, parts:-1]
    shared: Floats = wanted / np.maximum(wanted.sum(axis=1, keepdims=True), 1.0)
    return shared


def _answer(layout: Layout, edges: Floats, found: Posterior, wanted: Floats, following: Floats) -> Answer:
    """A posterior with the plans of its most probable goal; `wanted` (z, n, m), `following` (z, n)."""
    goals = found.belief[: len(layout.goals)]
    guidance = _templated(layout, edges, wanted[int(np.argmax(goals))])
    return Answer(found.belief, found.placements, goals @ following, guidance)


def _templated(layout: Layout, edges: Floats, wanted: Floats) -> dict[str, tuple[str, ...]]:
    """Guidance of one goal that wants (n, m): by type, the open positions that want it most, in order."""
    types = wanted.argmax(axis=0)
    still = np.flatnonzero(edges.sum(axis=0) == 0).tolist()
    return {
        name: tuple(layout.positions[i] for i in still if types[i] == part) for part, name in enumerate(layout.parts)
    }


def _read(layout: Layout, words: Ints) -> dict[str, tuple[str, ...]]:
    """Guidance as decoded (n, T), word for word up to the end of each plan; the guard judges it."""
    end = len(layout.words) - 1
    plans = {}
    for name, row in zip(layout.parts, words.tolist(), strict=True):
        length = row.index(end) if end in row else len(row)
        plans[name] = tuple(layout.words[word] for word in row[:length])
    return plans


def _assemble(layout: Layout, edges: Floats, answer: Answer) -> AssemblyPlan:
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
