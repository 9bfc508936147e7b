"""What the networks of the semantic planners are trained to say. Imports torch: never at run time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn

from learned.semantic.factored import FactoredNetwork, FactoredSettings
from learned.semantic.graph import EMPTY, Ints, Layout, one_hot
from learned.semantic.paper import PaperNetwork
from learned.semantic.scenarios import Scenarios

IGNORED = -100  # label of what no loss looks at, as cross_entropy has it


def paper_loss(network: PaperNetwork, layout: Layout, batch: Scenarios) -> Tensor:
    """Cross-entropies of goal, next object (Eq. 3) and plan words; the heads are given the true goal."""
    parts = len(layout.parts)
    goals = torch.tensor(batch.goals)
    graph, begin = network.embed(torch.tensor(one_hot(batch.seen, parts)))
    hard = nn.functional.one_hot(goals, len(layout.goals)).float()
    following = torch.tensor(next_type(layout, batch))
    words = torch.tensor(plan_words(layout, batch)).reshape(len(batch) * parts, -1)
    logits = network.teach(begin.flatten(0, 1), hard.repeat_interleave(parts, dim=0), words[:, :-1].clamp(min=0))
    entropy = nn.functional.cross_entropy
    known = max(int((following != IGNORED).sum()), 1)
    return (
        entropy(network.goal_head(graph), goals)
        + entropy(network.following(graph, hard), following, ignore_index=IGNORED, reduction="sum") / known
        + entropy(logits.flatten(0, 1), words[:, 1:].flatten(), ignore_index=IGNORED)
    )


def next_type(layout: Layout, batch: Scenarios) -> Ints:
    """(B,) part type that the demonstrator placed next, IGNORED where it is not known."""
    types: Ints = np.where(batch.following == EMPTY, IGNORED, layout.types[batch.goals, batch.following])
    return types


def plan_words(layout: Layout, batch: Scenarios) -> Ints:
    """(B, n, 2 + most of a type) words of every object's plan: its name, its open positions in order, the end."""
    rows, parts, end = len(batch), len(layout.parts), len(layout.words) - 1
    words = np.full((rows, parts, int(layout.quantities.max()) + 2), IGNORED)
    words[:, :, 0] = np.arange(parts)
    still = layout.wanted[batch.goals].astype(bool) & (batch.seen == EMPTY)[:, None, :]
    row, part, position = np.nonzero(still)
    words[row, part, still.cumsum(axis=2)[row, part, position]] = parts + position
    np.put_along_axis(words, 1 + still.sum(axis=2, keepdims=True), end, axis=2)
    return words


@dataclass(frozen=True)
class Counts:
    """All that the factored planner learns from demonstrated states, B rows.

    Attributes:
        named: (z, n, m) plans that name a slot, by goal.
        filled: (z, m) states in which a slot is filled.
        sizes: (z, m + 1) states by their number of filled slots.
        rows: (B',) goal, (B', m) filled slots and (B',) next slot of the states whose next slot is known.
    """

    named: Tensor
    filled: Tensor
    sizes: Tensor
    rows: tuple[Tensor, Tensor, Tensor]

    @staticmethod
    def of(layout: Layout, train: Scenarios) -> Counts:
        """Count."""
        goals, m = layout.types.shape
        filled = train.seen != EMPTY
        still, done, sizes = np.zeros((goals, m)), np.zeros((goals, m)), np.zeros((goals, m + 1))
        np.add.at(still, train.goals, ~filled)
        np.add.at(done, train.goals, filled)
        np.add.at(sizes, (train.goals, filled.sum(axis=1)), 1.0)
        known = train.following != EMPTY
        rows = (train.goals[known], filled[known].astype(float), train.following[known])
        return Counts(
            torch.tensor(still[:, None, :] * layout.wanted),
            torch.tensor(done),
            torch.tensor(sizes),
            (torch.tensor(rows[0]), torch.tensor(rows[1]), torch.tensor(rows[2])),
        )


def factored_loss(network: FactoredNetwork, counts: Counts, settings: FactoredSettings) -> Tensor:
    """Negative log-likelihoods of the slots that plans name, of the filled slots and of the next one, with a prior.

    Nothing is trained on noise: it is part of the model, and what is learned is who puts what where, and when.
    """
    states = counts.sizes.sum()
    table = -(network.log_table() * counts.named).sum() / counts.named.sum().clamp(min=1.0)
    first = -network.set_log_likelihood(counts.filled, counts.sizes) / states
    goals, filled, following = counts.rows
    slots = network.next_slot(filled, goals)
    order = nn.functional.nll_loss(slots, following, reduction="sum") / states
    prior = network.filled_first.penalty(settings) + network.filled_next.penalty(settings)
    return table + first + order + prior / states


def goal_prior(layout: Layout, train: Scenarios, settings: FactoredSettings) -> Tensor:
    """(z,) how often each goal is built, judged by the states of its demonstrations."""
    counts = np.bincount(train.goals, minlength=len(layout.goals)) + settings.goal_pseudo_n
    return torch.tensor(counts / counts.sum())
