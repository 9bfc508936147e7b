"""Planners of stacks: what lies on the wanted object, and what is to be taken first. Imports torch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bracket_ground.interfaces.planning import GraspPlan
from bracket_ground.interfaces.pose import Array
from bracket_lab.experiments.stacks.batches import FATHER, Answers, Batch, answers_of, batch_of, overlaps
from bracket_lab.experiments.stacks.checks import Kind, StackTraining
from bracket_lab.experiments.stacks.networks import GvmrnRf, PointerNet, Vmrn, WordNet
from bracket_lab.experiments.stacks.views import Labelled, StackView
from bracket_lab.learned.grasp.language import END, FIRST_TYPE, GRASP, MAX_WORDS, MOVE
from bracket_lab.learned.training.training_loop import fit

LARGEST_GRADIENT = 5.0
Relations = NDArray[np.bool_]  # (n, n), [i, j] whether j lies on i


class StackPlanner(Protocol):
    """Says of the objects of a picture what lies on which, and what to take before one of them."""

    def relations(self, view: StackView) -> Relations:
        """Who lies on whom."""
        ...

    def plan(self, view: StackView, required: int) -> GraspPlan:
        """What to do for `required`; its text names classes."""
        ...


class RelationPlanner:
    """Plans by relations alone: an object can be taken if nothing lies on it."""

    def relations(self, view: StackView) -> Relations:
        """Who lies on whom."""
        raise NotImplementedError

    def plan(self, view: StackView, required: int) -> GraspPlan:
        """All that lies on the wanted object, also by way of others; topmost first."""
        children = self.relations(view)
        above = children.astype(int)
        for _ in above:
            above = ((above + above @ above) > 0).astype(int)
        left, order = set(np.flatnonzero(above[required]).tolist()) - {required}, list[int]()
        while left:
            free = min(left, key=lambda at: (sum(above[at, other] for other in left if other != at), at))
            order.append(free)
            left.remove(free)
        return plan_of(view, 0.0 if order else 1.0, order)


class Always(RelationPlanner):
    """Takes whatever is wanted."""

    def relations(self, view: StackView) -> Relations:
        """Nothing lies on anything."""
        return np.zeros((len(view.names),) * 2, dtype=bool)


class Topmost(RelationPlanner):
    """Of two objects whose boxes overlap, the one that reaches higher lies on the other."""

    def relations(self, view: StackView) -> Relations:
        """Who lies on whom, by the true heights."""
        if view.tops_m is None:
            raise ValueError("the heights of the objects are not known")
        return overlaps(view.boxes).astype(bool) & (view.tops_m[None] > view.tops_m[:, None])


class Pairs(RelationPlanner):
    """VMRN and GVMRN-RF: the likeliest relation of each pair."""

    def __init__(self, network: nn.Module, classes: Sequence[str]) -> None:
        self._network, self._classes = network.eval(), classes

    def relations(self, view: StackView) -> Relations:
        """Who lies on whom."""
        if not view.names:
            return np.zeros((0, 0), dtype=bool)
        with torch.no_grad():
            answer = self._network(batch_of([view], self._classes))
        logits = answer[0] if isinstance(answer, tuple) else answer
        found: Relations = (logits[0].argmax(-1) == FATHER).numpy()
        np.fill_diagonal(found, False)
        return found


class Pointing:
    """The default: graspability of each node, and nodes in the order in which they are to be taken."""

    def __init__(self, network: PointerNet, classes: Sequence[str]) -> None:
        self._network, self._classes = network.eval(), classes
        self._seen: tuple[StackView, Array, list[list[int]]] | None = None

    def relations(self, view: StackView) -> Relations:
        """Who lies on whom: what is pointed at when each one is wanted."""
        found = np.zeros((len(view.names),) * 2, dtype=bool)
        for row, words in enumerate(self._answer(view)[1]):
            found[row, words] = True
        return found

    def plan(self, view: StackView, required: int) -> GraspPlan:
        """What to take first."""
        graspable, words = self._answer(view)
        order = [] if graspable[required] >= 0.5 else words[required]
        return plan_of(view, float(graspable[required]), order)

    def _answer(self, view: StackView) -> tuple[Array, list[list[int]]]:
        """Probability that each object can be taken, and what is to be taken before it."""
        if self._seen is None or self._seen[0] is not view:
            self._seen = view, *self._asked(view)
        return self._seen[1], self._seen[2]

    def _asked(self, view: StackView) -> tuple[Array, list[list[int]]]:
        count = len(view.names)
        if not count:
            return np.zeros(0), []
        with torch.no_grad():
            verdicts, words = self._network(batch_of([view], self._classes))
        rows = words[0].tolist()
        return torch.sigmoid(verdicts[0]).double().numpy(), [row[: (*row, count).index(count)] for row in rows]


class Wording:
    """The paper's: graspability, and a sentence that names classes."""

    def __init__(self, network: WordNet, classes: Sequence[str]) -> None:
        self._network, self._classes = network.eval(), classes

    def relations(self, view: StackView) -> Relations:
        """Who lies on whom: what each sentence names."""
        found = np.zeros((len(view.names),) * 2, dtype=bool)
        for row in range(len(view.names)):
            found[row, list(self.plan(view, row).blockers)] = True
        return found

    def plan(self, view: StackView, required: int) -> GraspPlan:
        """What to take first: the sentence's words, and for each an object of that class."""
        batch, flags = batch_of([view], self._classes), torch.zeros(1, len(view.names))
        flags[0, required] = 1.0
        with torch.no_grad():
            nodes = self._network.nodes(batch, flags)
            both, verdicts, states = self._network.net.encode(nodes, batch.weights, batch.present)
            others = (batch.labels[0].sum(0) - batch.labels[0, required])[None]
            words = self._network.net.decoder.greedy(states, both[:, required], batch.present, others)[0].tolist()
        graspable = float(torch.sigmoid(verdicts[0, required]))
        if graspable >= 0.5:
            return plan_of(view, graspable, [])
        said = [self._classes[word - FIRST_TYPE] for word in words if word >= FIRST_TYPE]
        return plan_of(view, graspable, _meant(view, said, required))


def _meant(view: StackView, said: Sequence[str], required: int) -> list[int]:
    """An object of each class that is named, but for the wanted one."""
    meant: list[int] = []
    for name in said:
        left = [at for at, other in enumerate(view.names) if other == name and at not in (required, *meant)]
        meant += left[:1]
    return meant


def plan_of(view: StackView, graspable: float, order: Sequence[int]) -> GraspPlan:
    """A plan in the paper's words."""
    names = [view.names[at] for at in order]
    text = f"move {' and '.join(names)}" if names else "grasp" if graspable >= 0.5 else "help"
    return GraspPlan(graspable, tuple(order), not names and graspable < 0.5, text)


def train_planner(
    kind: Kind, examples: Sequence[Labelled], seed: int, settings: StackTraining, *, quiet: bool = True
) -> StackPlanner:
    """A planner of a kind, trained on views of true boxes."""
    torch.manual_seed(seed)
    rng, wide = np.random.default_rng([seed, 22]), examples[0].view.regions.shape[1]
    network = _network(kind, wide, settings)
    schedule = settings.heads
    optimiser = torch.optim.AdamW(network.parameters(), schedule.peak_rate, weight_decay=schedule.weight_decay)
    batches = max(1, len(examples) // schedule.batch)

    def losses(_: int) -> Iterator[Tensor]:
        for chosen in np.array_split(rng.permutation(len(examples))[: batches * schedule.batch], batches):
            some = [examples[index] for index in chosen.tolist()]
            batch, answers = batch_of([row.view for row in some], settings.classes), answers_of(some)
            yield _word_loss(network, batch, answers) if isinstance(network, WordNet) else network.loss(batch, answers)

    network.train()
    fit(network, optimiser, losses, schedule.epochs, batches, largest_gradient=LARGEST_GRADIENT, rng=rng, quiet=quiet)
    if isinstance(network, WordNet):
        return Wording(network, settings.classes)
    if isinstance(network, PointerNet):
        return Pointing(network, settings.classes)
    return Pairs(network, settings.classes)


def _network(kind: Kind, features: int, settings: StackTraining) -> Vmrn | GvmrnRf | PointerNet | WordNet:
    if kind == "vmrn":
        return Vmrn(features, settings.hidden)
    if kind == "gvmrn_rf":
        return GvmrnRf(features, settings.hidden)
    count = len(settings.classes)
    return WordNet(features, count) if kind == "paper" else PointerNet(features, count)


def _word_loss(network: WordNet, batch: Batch, answers: Answers) -> Tensor:
    """Cross-entropy of all verdicts, and of the words about one object at random of each picture."""
    chosen = torch.multinomial(batch.present, 1)
    flags = torch.zeros_like(batch.present).scatter(1, chosen, 1.0)
    both, verdicts, states = network.net.encode(network.nodes(batch, flags), batch.weights, batch.present)
    there, rows = batch.present > 0, torch.arange(len(chosen))
    of_nodes = nn.functional.binary_cross_entropy_with_logits(verdicts[there], answers.graspable[there])
    asked = chosen[:, 0]
    words = _sentences(answers.order[rows, asked], batch)
    scores = network.net.decoder.forced(states, both[rows, asked], batch.present, words)
    said = nn.functional.cross_entropy(scores.transpose(1, 2), words, reduction="none").sum(1).mean()
    return of_nodes + said


def _sentences(order: Tensor, batch: Batch) -> Tensor:
    """Word numbers (b, MAX_WORDS) that name what is to be taken (b, MOST_ON_TOP), filled up with END."""
    kinds = batch.labels.argmax(-1)
    words = torch.full((len(order), MAX_WORDS), END)
    for row, taken in enumerate(order.tolist()):
        named = [FIRST_TYPE + int(kinds[row, at]) for at in taken if at >= 0][: MAX_WORDS - 1]
        words[row, 0] = MOVE if named else GRASP
        words[row, 1 : 1 + len(named)] = torch.tensor(named, dtype=torch.long)
    return words
