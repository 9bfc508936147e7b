"""The paper's semantic planner at run time, and any planner by its kind; numpy and onnxruntime, no torch."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bracket_cell.learned.inference.onnx_model import Network, OnnxModel
from bracket_cell.learned.semantic.confusions import Confusions
from bracket_cell.learned.semantic.goals import OpenGoals
from bracket_cell.learned.semantic.graph import Floats, Ints, Layout
from bracket_cell.learned.semantic.model import LEAST_BELIEF, Answer, BayesPlanner, LearnedPlanner, assembly_plan
from bracket_cell.learned.semantic.model import load_semantic_planner as load_trained
from bracket_ground.interfaces.planning import AssemblyPlan, AssemblyState, SemanticPlanner
from bracket_ground.interfaces.product import Product


class PaperPlanner(LearnedPlanner):
    """The paper's graph network and LSTM decoder; plans are decoded once for every goal and mixed by belief.

    The product may have fewer goals than the network was trained for.
    """

    def __init__(self, product: Product, model: Network) -> None:
        super().__init__(product, model)
        known, wanted = model.card.vocabulary["goals"], self.layout.vocabulary["goals"]
        self._goals = [known.index(goal) for goal in wanted]

    @staticmethod
    def load(product: Product, weights: Path) -> PaperPlanner:
        """With the network of a file.

        Raises:
            ModelError: it is missing, damaged, of another kind, trained for another product, or cannot answer.
        """
        model, wanted = OnnxModel.load(weights, "semantic.paper"), Layout.of(product).vocabulary
        known = model.card.vocabulary.get("goals", ())
        if set(wanted["goals"]) <= set(known):
            wanted = {**wanted, "goals": known}  # fewer than it was trained for
        for use, words in wanted.items():
            model.require_vocabulary(use, words)
        planner = PaperPlanner(product, model)
        planner.plan(AssemblyState({}))  # weights that cannot answer at all fail here
        return planner

    def plan(self, state: AssemblyState) -> AssemblyPlan:
        edges = self.layout.encode(state)
        found = {name: values[self._goals] for name, values in self._model.run({"edges": edges}).items()}
        belief, words = found["belief"] / max(float(found["belief"].sum()), LEAST_BELIEF), found["words"]
        placements = np.tensordot(belief, wanted_by_words(self.layout, words), 1) * (1.0 - edges.any(axis=0))
        guidance = _read(self.layout, words[int(np.argmax(belief))])
        return assembly_plan(self.layout, edges, Answer(belief, placements, belief @ found["following"], guidance))


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


def _read(layout: Layout, words: Ints) -> dict[str, tuple[str, ...]]:
    """Guidance as decoded (n, T), word for word up to the end of each plan; the guard judges it."""
    end = len(layout.words) - 1
    plans = {}
    for name, row in zip(layout.parts, words.tolist(), strict=True):
        length = row.index(end) if end in row else len(row)
        plans[name] = tuple(layout.words[word] for word in row[:length])
    return plans


def load_semantic_planner(
    kind: str,
    weights: Path | None,
    product: Product,
    goals: OpenGoals | None = None,
    confusions: Confusions | None = None,
) -> SemanticPlanner:
    """The planner of a kind, for experiments and trainings; "bayes" reads no weights, "paper" no goals or confusions.

    Raises:
        ModelError: the weights cannot be used.
    """
    if kind == "bayes":
        return BayesPlanner(product, goals, confusions)
    assert weights is not None
    if kind == "paper":
        return PaperPlanner.load(product, weights)
    return load_trained(kind, weights, product, goals, confusions)
