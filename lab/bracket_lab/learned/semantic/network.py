"""The factored semantic planner in torch: learned slots, learned habits of order, exact inference under noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from bracket_cell.learned.semantic.graph import EMPTY, Layout
from bracket_cell.learned.semantic.posterior import Noise
from bracket_cell.learned.semantic.settings import FactoredSettings
from bracket_lab.learned.semantic.misdetection import Scenarios

SHARPNESS = 5.0  # scale of the slot table's parameters: one rate suits them and the rest, and slots become certain
MOST_NODES = 8  # of the quadrature over misdetections: exact for up to twice as many, less one


class FactoredAnswer(NamedTuple):
    """Outputs of the exported network, all but `following` as in `bracket_cell.learned.semantic.posterior.Likelihood`.

    Shapes: goals (z,), still_open (z, m), wanted (z, n, m), prior (z,), usual (), following (z, n): probability of
    the next type under every goal.
    """

    goals: Tensor
    still_open: Tensor
    wanted: Tensor
    prior: Tensor
    usual: Tensor
    following: Tensor


class Habits(nn.Module):
    """Log-preferences (z, m) of goals' slots: of a position, of the type that it holds, and of the goal's own."""

    def __init__(self, goals: int, parts: int, positions: int) -> None:
        super().__init__()
        self.position = nn.Parameter(torch.zeros(positions, dtype=torch.float64))
        self.part = nn.Parameter(torch.zeros(parts, dtype=torch.float64))
        self.own = nn.Parameter(torch.zeros(goals, positions, dtype=torch.float64))

    def forward(self, wanted: Tensor) -> Tensor:
        """Preferences, given what goals want (z, n, m)."""
        preferred: Tensor = self.position + torch.einsum("o,gop->gp", self.part, wanted) + self.own
        return preferred

    def penalty(self, settings: FactoredSettings) -> Tensor:
        """Negative logarithm of the prior."""
        shared = self.position.square().sum() + self.part.square().sum()
        total: Tensor = 0.5 * (shared / settings.shared_scale**2 + self.own.square().sum() / settings.habit_scale**2)
        return total


class FactoredNetwork(nn.Module):
    """Goals as independent slots with habits: what one demonstration says of a slot holds wherever it is seen.

    The slot table T[g, o, p] is the probability that goal g wants o at p. After k placements the filled slots S of
    goal g have the probability

        P(S | g, k) = prod_{p in S} v[g, p] / e_k(v[g]),

    e_k the elementary symmetric polynomial, v the habits (all ones for people without). A report is right with
    probability a, or as one given other with probability q (`Noise`). Summed over all ways in which k reports may
    stem from k slots,

        P(reports | g) = integral of exp(-t) e_k(w(t)) dt / e_k(v),  w_p = v_p (t q + (a - q) T[g, report at p, p]),

    where the integral, which counts the ways in which misdetected reports may be exchanged, is a sum over
    Gauss-Laguerre nodes. Without habits this is the likelihood of `BayesPosterior`. The next slot is a softmax of
    habits of their own over the open slots.
    """

    def __init__(self, layout: Layout, settings: FactoredSettings) -> None:
        super().__init__()
        goals, positions = layout.types.shape
        parts = len(layout.parts)
        self.positions = positions
        self.table = nn.Parameter(torch.zeros(goals, parts, positions, dtype=torch.float64))
        self.filled_first = Habits(goals, parts, positions)
        self.filled_next = Habits(goals, parts, positions)
        noise = Noise.of(layout, settings.error)
        nodes, weights = np.polynomial.laguerre.laggauss(min(MOST_NODES, positions // 2 + 1))
        count = np.arange(positions + 1)
        constants = {
            "prior": np.full(goals, 1.0 / goals),
            "wrong": noise.wrong,
            "excess": noise.excess,
            "nodes": nodes[:, None, None],
            "weights": weights,
            "shift": np.eye(positions + 1, k=1),
            "complement": (count[:, None, None] == count[:, None] + count).astype(float),
        }
        for name, value in constants.items():
            self.register_buffer(name, torch.tensor(value, dtype=torch.float64))

    def log_table(self) -> Tensor:
        """Logarithm of the slot table T (z, n, m)."""
        return (SHARPNESS * self.table).log_softmax(dim=1)

    def set_log_likelihood(self, filled: Tensor, sizes: Tensor) -> Tensor:
        """Sum of log P(S | g, k) over states, from how often slots (z, m) and how many (z, m + 1) were filled."""
        preferred = self.filled_first(self.log_table().exp().detach())
        total = torch.log(self.partial_products(preferred.exp())[-1])
        likelihood: Tensor = (preferred * filled).sum() - (total * sizes).sum()
        return likelihood

    def next_slot(self, filled: Tensor, goals: Tensor) -> Tensor:
        """Filled positions (B, m) and goals (B,) to log-probabilities (B, m) of the slot that is filled next."""
        preferred = self.filled_next(self.log_table().exp().detach())
        slots: Tensor = (preferred[goals] - 1e6 * filled).log_softmax(dim=1)
        return slots

    def partial_products(self, values: Tensor) -> list[Tensor]:
        """Coefficients (..., m + 1) of prod (1 + v_p x) over the first 0, 1, ..., m of the values (..., m)."""
        shift = self.get_buffer("shift")
        products = [torch.zeros_like(values[..., :1]) * shift[0] + torch.eye(1, len(shift), dtype=torch.float64)[0]]
        for position in range(self.positions):
            products.append(products[-1] + values[..., position, None] * (products[-1] @ shift))
        return products

    def forward(self, edges: Tensor) -> FactoredAnswer:
        """One graph, edges (n, m)."""
        reports = edges.double()
        filled = reports.sum(dim=0)
        count = (torch.arange(self.positions + 1) == filled.sum()).double()
        wanted = self.log_table().exp()
        habits = self.filled_first(wanted).exp()
        goals, still_open = self._likelihood(habits, (wanted * reports).sum(dim=1), count)
        every = torch.arange(len(wanted))
        following = torch.einsum("gop,gp->go", wanted, self.next_slot(filled.expand(len(every), -1), every).exp())
        return FactoredAnswer(
            goals, still_open, wanted, self.get_buffer("prior"), self._usual(filled, count), following
        )

    def _likelihood(self, habits: Tensor, right: Tensor, count: Tensor) -> tuple[Tensor, Tensor]:
        """Likelihood (z,), and (z, m) that with each slot open; `right` (z, m) where reports agree, `count` one-hot."""
        wrong, excess = self.get_buffer("wrong") @ count, self.get_buffer("excess") @ count
        values = habits * (self.get_buffer("nodes") * wrong + excess * right)
        both = self.partial_products(torch.stack([values, values.flip(2)]))
        before = torch.stack([products[0] for products in both[:-1]], dim=2)
        after = torch.stack([products[1] for products in both[-2::-1]], dim=2)
        rest = torch.einsum("kij,k->ij", self.get_buffer("complement"), count)
        weights = self.get_buffer("weights")
        everything = self.partial_products(habits)[-1] @ count
        likelihood = torch.einsum("n,ngk,k->g", weights, both[-1][0], count) / everything
        still_open = torch.einsum("n,ngp->gp", weights, ((before @ rest) * after).sum(dim=3))
        return likelihood, still_open / everything[:, None]

    def _usual(self, filled: Tensor, count: Tensor) -> Tensor:
        """How much likelier these filled positions are by the habits that all goals share than by chance."""
        shared = self.filled_first(self.log_table().exp()).mean(dim=0)
        by_habit = torch.exp((shared * filled).sum()) / (self.partial_products(shared.exp())[-1] @ count)
        by_chance = self.partial_products(torch.ones_like(shared))[-1] @ count
        return by_habit * by_chance


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
