"""The paper's semantic planner in torch: GraphSAGE, goal and next-object heads, LSTM (Eq. 1-3, section 3.1.1)."""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from bracket_cell.learned.semantic.graph import EMPTY, Ints, Layout, one_hot
from bracket_cell.learned.semantic.settings import PaperSettings
from bracket_lab.learned.semantic.misdetection import Scenarios

IGNORED = -100  # label of what no loss looks at, as cross_entropy has it


class PaperAnswer(NamedTuple):
    """Outputs of the exported network: (z,), (z, n), and words (z, n, T) of a plan for every goal and object."""

    belief: Tensor
    following: Tensor
    words: Tensor


class SageLayer(nn.Module):
    """One GraphSAGE layer: h_v = relu(W_1 h_v + W_2 aggregate of h_u over the neighbours u) (Eq. 2)."""

    def __init__(self, inputs: int, outputs: int, aggregation: str) -> None:
        super().__init__()
        self.own = nn.Linear(inputs, outputs)
        self.neighbours = nn.Linear(inputs, outputs, bias=False)
        self.mean = aggregation == "mean"

    def forward(self, nodes: Tensor, adjacency: Tensor) -> Tensor:
        """Nodes (B, N, inputs) and adjacency (B, N receivers, N senders) to nodes (B, N, outputs)."""
        if self.mean:
            adjacency = adjacency / adjacency.sum(dim=2, keepdim=True).clamp(min=1.0)
        return torch.relu(self.own(nodes) + self.neighbours(adjacency @ nodes))


class PaperNetwork(nn.Module):
    """Graph in; goal, next object and plans out.

    Nodes are told apart by a one-hot of their identity; the graph's embedding Phi is their mean. The decoder
    starts from [embedding of the graph, or of the object's node, goal], is given the object's name as its first word,
    and says its positions in order, then the end.
    """

    def __init__(self, layout: Layout, settings: PaperSettings) -> None:
        super().__init__()
        goals, positions = layout.types.shape
        parts, hidden, words = len(layout.parts), settings.hidden, len(layout.words)
        self.parts, self.goals, self.nodes, self.words = parts, goals, parts + positions, words
        self.longest = int(layout.quantities.max()) + 1
        self.direction, self.from_object = settings.direction, settings.start == "object"
        widths = [self.nodes] + [hidden] * settings.layers
        self.layers = nn.ModuleList(
            SageLayer(inputs, outputs, settings.aggregation) for inputs, outputs in pairwise(widths)
        )
        self.goal_head = nn.Linear(hidden, goals)
        self.next_head = nn.Sequential(nn.Linear(hidden + goals, hidden), nn.ReLU(), nn.Linear(hidden, parts))
        self.start = nn.Linear(hidden + goals, 2 * hidden)
        self.embedding = nn.Embedding(words, hidden)
        self.cell = nn.LSTMCell(hidden, hidden)
        self.say = nn.Linear(hidden, words)

    def embed(self, edges: Tensor) -> tuple[Tensor, Tensor]:
        """Edges (B, n, m) to embeddings of graphs (B, hidden), and of what plans start from (B, n, hidden)."""
        nodes = torch.eye(self.nodes).expand(edges.shape[0], -1, -1)
        adjacency = self.adjacency(edges)
        for layer in self.layers:
            nodes = layer(nodes, adjacency)
        graph = nodes.mean(dim=1)
        return graph, nodes[:, : self.parts] if self.from_object else graph[:, None].expand(-1, self.parts, -1)

    def adjacency(self, edges: Tensor) -> Tensor:
        """(B, N, N) receivers by senders; objects come before positions."""
        parts, positions = edges.shape[1:]
        to_objects = nn.functional.pad(edges, (parts, 0, 0, positions))
        to_positions = nn.functional.pad(edges.transpose(1, 2), (0, positions, parts, 0))
        if self.direction == "both":
            return to_objects + to_positions
        return to_objects if self.direction == "position_to_object" else to_positions

    def following(self, graph: Tensor, goal: Tensor) -> Tensor:
        """Next-object logits (B, n) from graph embeddings (B, hidden) and one-hot goals (B, z)."""
        logits: Tensor = self.next_head(torch.cat([graph, goal], dim=1))
        return logits

    def teach(self, begin: Tensor, goal: Tensor, said: Tensor) -> Tensor:
        """Teacher forcing: logits (B, T, words) of the words after each of those said (B, T)."""
        state = self._start(begin, goal)
        logits = []
        for step in range(said.shape[1]):
            state = self.cell(self.embedding(said[:, step]), state)
            logits.append(self.say(state[0]))
        return torch.stack(logits, dim=1)

    def decode(self, begin: Tensor, goal: Tensor, first: Tensor) -> Tensor:
        """Words (B, T), each the most probable after those before; `first` (B,) are the objects' names."""
        state = self._start(begin, goal)
        word, words = first, []
        for _ in range(self.longest):
            state = self.cell(self.embedding(word), state)
            word = self.say(state[0]).argmax(dim=1)
            words.append(word)
        return torch.stack(words, dim=1)

    def forward(self, edges: Tensor) -> PaperAnswer:
        """One graph, edges (n, m): plans decoded once for each hard goal (soft goals would blend plans)."""
        graph, begin = self.embed(edges[None])
        goals = torch.eye(self.goals)
        graphs = graph.expand(self.goals, -1)
        first = torch.arange(self.parts).repeat(self.goals)
        words = self.decode(begin[0].repeat(self.goals, 1), goals.repeat_interleave(self.parts, dim=0), first)
        return PaperAnswer(
            self.goal_head(graph)[0].softmax(dim=0),
            self.following(graphs, goals).softmax(dim=1),
            words.reshape(self.goals, self.parts, self.longest),
        )

    def _start(self, begin: Tensor, goal: Tensor) -> tuple[Tensor, Tensor]:
        hidden, memory = self.start(torch.cat([begin, goal], dim=1)).chunk(2, dim=1)
        return torch.tanh(hidden), memory


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
