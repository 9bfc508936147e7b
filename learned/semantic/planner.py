"""Semantic planners at run time: an assembly state in, belief and plans out; numpy and onnxruntime, no torch."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from cell.interfaces.errors import InputError, ModelError
from cell.interfaces.planning import UNKNOWN_GOAL, AssemblyPlan, AssemblyState, SemanticPlanner
from cell.interfaces.product import Product
from learned.onnx_model import ModelCard, OnnxModel
from learned.semantic.bayes import BayesPosterior
from learned.semantic.graph import Floats, Ints, Layout

SemanticKind = Literal["paper", "factored", "bayes"]
LEAST_BELIEF = 1e-9  # placements believed less are left out of the answer


@dataclass(frozen=True)
class Answer:
    """What any planner finds, by index.

    Attributes:
        belief: (z,) or, with the probability that it is none of them, (z + 1,).
        wanted: (z, n, m) probability that a goal wants a type at a position.
        following: (z, n) probability of the next type under every goal.
    """

    belief: Floats
    wanted: Floats
    following: Floats


def load_semantic_planner(kind: str, path: Path | None, product: Product) -> SemanticPlanner:
    """The planner that the configuration names.

    Args:
        kind: "paper", "factored", or "bayes", which has no weights and ignores `path`.
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
        answer = Answer(self._posterior(edges), self._layout.wanted, following)
        return _assemble(self._layout, edges, answer, _templated(self._layout, edges, answer))


class LearnedPlanner:
    """Base of the planners whose answers come from a network."""

    def __init__(self, product: Product, model: OnnxModel) -> None:
        self._layout = Layout.of(product)
        self._model = model

    @property
    def card(self) -> ModelCard:
        """Where the weights come from."""
        return self._model.card


class FactoredPlanner(LearnedPlanner):
    """A goal head over (object, position) edges and a learned slot table; guidance is a template over the table."""

    def plan(self, state: AssemblyState) -> AssemblyPlan:
        edges = self._layout.encode(state)
        found = self._model.run({"edges": edges})
        answer = Answer(found["belief"], found["wanted"], found["following"])
        return _assemble(self._layout, edges, answer, _templated(self._layout, edges, answer))


class PaperPlanner(LearnedPlanner):
    """The paper's graph network and LSTM decoder; plans are decoded once for every goal and mixed by belief."""

    def plan(self, state: AssemblyState) -> AssemblyPlan:
        edges = self._layout.encode(state)
        found = self._model.run({"edges": edges})
        words = found["words"]
        answer = Answer(found["belief"], wanted_by_words(self._layout, words), found["following"])
        return _assemble(self._layout, edges, answer, _read(self._layout, words[int(np.argmax(answer.belief))]))


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


def _templated(layout: Layout, edges: Floats, answer: Answer) -> dict[str, tuple[str, ...]]:
    """Guidance of the most probable goal: by type, the open positions that want it most, in order."""
    goal = int(np.argmax(answer.belief[: len(layout.goals)]))
    types = answer.wanted[goal].argmax(axis=0)
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


def _assemble(layout: Layout, edges: Floats, answer: Answer, guidance: dict[str, tuple[str, ...]]) -> AssemblyPlan:
    goals = len(layout.goals)
    belief = answer.belief / answer.belief.sum()
    if not np.isfinite(belief).all():
        raise ModelError(f"belief over goals is {answer.belief.tolist()}, not a distribution")
    placements = np.tensordot(belief[:goals], answer.wanted, 1) * (1.0 - edges.any(axis=0))
    return AssemblyPlan(
        goal_belief=dict(zip((*layout.goals, UNKNOWN_GOAL), belief.tolist(), strict=False)),
        next_belief={
            (layout.parts[part], layout.positions[position]): float(placements[part, position])
            for part, position in np.argwhere(placements > LEAST_BELIEF)
        },
        next_part=_next_part(layout, edges, placements, belief[:goals] @ answer.following),
        guidance=guidance,
    )


def _next_part(layout: Layout, edges: Floats, placements: Floats, following: Floats) -> str | None:
    """The most probable type of those that remain: by quantity, unless that rules out all that is still wanted."""
    if edges.any(axis=0).all():
        return None
    left = edges.sum(axis=1) < layout.quantities
    wanted = placements.sum(axis=1) > LEAST_BELIEF
    candidates = next((some for some in (wanted & left, wanted, left) if some.any()), None)
    if candidates is None:
        return None
    return layout.parts[int(np.argmax(np.where(candidates, following, -1.0)))]
