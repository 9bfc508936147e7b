"""The paper's grasp planner in torch: WL-GNN with weighted edges, graspability head, LSTM with attention (Eq. 5-7)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from cell.interfaces.product import Product
from learned.grasp.graph import MAX_PARTS, Attention, EdgeKind, mirror_signs, scene_graph
from learned.grasp.language import FIRST_LETTER, MAX_WORDS, WORDS, encode, grammar
from learned.grasp.scenes import Scene

_IMPOSSIBLE = -1e9


class GraphConvolution(nn.Module):
    """x_i' = W x_i + V sum_j e_ij x_j + b (Eq. 5), on dense batches; without W for the plain graph convolution."""

    def __init__(self, narrow: int, wide: int, own: bool = True) -> None:
        super().__init__()
        self.own: nn.Module = nn.Linear(narrow, wide) if own else _Bias(wide)
        self.neighbours = nn.Linear(narrow, wide, bias=False)

    def forward(self, nodes: Tensor, weights: Tensor) -> Tensor:
        """Nodes (b, n, narrow) and weights (b, n, n) to nodes (b, n, wide)."""
        updated: Tensor = self.own(nodes) + self.neighbours(weights @ nodes)
        return updated


class _Bias(nn.Module):
    """A constant that is learned."""

    def __init__(self, wide: int) -> None:
        super().__init__()
        self.bias = nn.Parameter(torch.zeros(wide))

    def forward(self, nodes: Tensor) -> Tensor:  # noqa: ARG002
        """(wide,), whatever the nodes."""
        return self.bias


class PaperNet(nn.Module):
    """Encoder, head and decoder; inputs are batches of padded scene graphs.

    Args:
        types: number of part types; the nodes' first features say which, for the attention as printed.
    """

    def __init__(
        self,
        features: int,
        hidden: int,
        layers: int,
        own: bool = True,
        attention: Attention = "additive",
        types: int = 0,
    ) -> None:
        super().__init__()
        self.features, self.types, self.printed = features, types, attention == "printed"
        widths = [features] + [hidden] * layers
        self.convolutions = nn.ModuleList(GraphConvolution(narrow, wide, own) for narrow, wide in pairwise(widths))
        self.head = nn.Sequential(nn.Linear(2 * hidden, hidden), nn.ReLU(), nn.Linear(hidden, 1))
        self.decoder = Decoder(hidden, attention, hidden + (types + 1 if self.printed else 0))

    def encode(self, nodes: Tensor, weights: Tensor, present: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Nodes by Eq. 5, what the decoder is told of each, and graspability by Eq. 6.

        Returns:
            What the decoder attends to (b, n, wide): embeddings, as printed with label and graspability of each node;
            embeddings of required part and graph together (b, 2 hidden); logits (b, n), or (b, 1) of the required part.
        """
        x = nodes
        for convolution in self.convolutions:
            x = torch.relu(convolution(x, weights)) * present[..., None]
        graph = x.sum(1) / present.sum(1, keepdim=True)
        summary = torch.cat([x[:, 0], graph], dim=-1)
        if not self.printed:
            return x, summary, self.head(summary)
        verdicts = self.head(torch.cat([x, graph[:, None].expand_as(x)], dim=-1)).squeeze(-1)
        told = torch.cat([x, nodes[..., : self.types], torch.sigmoid(verdicts)[..., None]], dim=-1)
        return told, summary, verdicts

    def forward(self, nodes: Tensor, weights: Tensor, present: Tensor) -> tuple[Tensor, Tensor]:
        """Logit (b,) that the required part is graspable (Eq. 6), and word numbers (b, MAX_WORDS) of a solution."""
        told, summary, verdicts = self.encode(nodes, weights, present)
        return verdicts[:, 0], self.decoder.greedy(told, summary, present)

    def scores(self, nodes: Tensor, weights: Tensor, present: Tensor, words: Tensor) -> tuple[Tensor, Tensor]:
        """Logits (b, n or 1) of graspability, the required part's first, and word logits (b, MAX_WORDS, words).

        Each word is given the right words before.
        """
        told, summary, verdicts = self.encode(nodes, weights, present)
        return verdicts, self.decoder.forced(told, summary, present, words)


class Decoder(nn.Module):
    """LSTM that attends to the nodes at each word (Eq. 7): score h' W f as printed, or additive; or a plain LSTM.

    Args:
        wide: of what it is told of each node.
    """

    grammar: Tensor

    def __init__(self, hidden: int, attention: Attention, wide: int) -> None:
        super().__init__()
        self.attention, self.wide = attention, wide
        self.begin = nn.Linear(2 * hidden, hidden)
        self.embedding = nn.Embedding(len(WORDS) + 1, hidden)
        self.cell = nn.LSTMCell(hidden + wide, hidden)
        self.query = nn.Linear(hidden, hidden, bias=False)
        self.key = nn.Linear(wide, hidden)
        self.energy = nn.Linear(hidden, 1, bias=False)
        self.word = nn.Linear(hidden + wide, len(WORDS))
        self.register_buffer("grammar", torch.tensor(grammar(), dtype=torch.float32), persistent=False)

    def forced(self, embedded: Tensor, summary: Tensor, present: Tensor, words: Tensor) -> Tensor:
        """Word logits (b, MAX_WORDS, words) with teacher forcing."""
        state = self._start(summary)
        previous = torch.full_like(words[:, 0], len(WORDS))
        logits = []
        for step in range(MAX_WORDS):
            scores, state = self._step(previous, embedded, present, state)
            logits.append(scores)
            previous = words[:, step]
        return torch.stack(logits, dim=1)

    def greedy(self, embedded: Tensor, summary: Tensor, present: Tensor) -> Tensor:
        """The likeliest word at each step (b, MAX_WORDS) among those that grammar and scene allow."""
        state = self._start(summary)
        # Letters of absent parts, and those already said, cannot be said.
        unspeakable = nn.functional.pad((1 - present) * _IMPOSSIBLE, (FIRST_LETTER, 0))
        previous = torch.full((len(summary),), len(WORDS), dtype=torch.long)
        letter = (torch.arange(len(WORDS)) >= FIRST_LETTER).to(present.dtype)
        words = []
        for _ in range(MAX_WORDS):
            scores, state = self._step(previous, embedded, present, state)
            previous = (scores + self.grammar[previous] + unspeakable).argmax(-1)
            said = nn.functional.one_hot(previous, len(WORDS)).to(present.dtype)
            unspeakable = unspeakable + said * letter * _IMPOSSIBLE
            words.append(previous)
        return torch.stack(words, dim=1)

    def _start(self, summary: Tensor) -> tuple[Tensor, Tensor]:
        hidden = torch.tanh(self.begin(summary))
        return hidden, torch.zeros_like(hidden)

    def _step(
        self, previous: Tensor, embedded: Tensor, present: Tensor, state: tuple[Tensor, Tensor]
    ) -> tuple[Tensor, tuple[Tensor, Tensor]]:
        context = self._context(state[0], embedded, present)
        hidden, memory = self.cell(torch.cat([self.embedding(previous), context], dim=-1), state)
        return self.word(torch.cat([hidden, context], dim=-1)), (hidden, memory)

    def _context(self, hidden: Tensor, embedded: Tensor, present: Tensor) -> Tensor:
        if self.attention == "none":
            return hidden.new_zeros((len(hidden), self.wide))
        if self.attention == "printed":
            energy = (self.key(embedded) * hidden[:, None]).sum(-1)
        else:
            energy = self.energy(torch.tanh(self.query(hidden)[:, None] + self.key(embedded))).squeeze(-1)
        attention = torch.softmax(energy + (1 - present) * _IMPOSSIBLE, dim=-1)
        return (attention[..., None] * embedded).sum(1)


@dataclass(frozen=True)
class GraphData:
    """Every part of many scenes as the required one.

    Attributes:
        nodes, weights, present: (parts, ...) as in SceneGraph.
        graspable: (parts, MAX_PARTS) of every node, the required one first.
        words: (parts, MAX_WORDS).
        mirrors: (4, features) signs; a mirrored scene has the same answer.
    """

    nodes: Tensor
    weights: Tensor
    present: Tensor
    graspable: Tensor
    words: Tensor
    mirrors: Tensor

    def __len__(self) -> int:
        return len(self.nodes)

    def loss(self, net: PaperNet, chosen: Tensor) -> Tensor:
        """Cross-entropy of verdict and of words, in randomly mirrored scenes."""
        mirrors = self.mirrors[torch.randint(4, (len(chosen),))]
        graph = self.nodes[chosen] * mirrors[:, None], self.weights[chosen], self.present[chosen]
        words = self.words[chosen]
        verdicts, scores = net.scores(*graph, words)
        count = verdicts.shape[1]
        of_nodes = nn.functional.binary_cross_entropy_with_logits(
            verdicts, self.graspable[chosen, :count], weight=graph[2][:, :count], reduction="sum"
        )
        verdict_loss = of_nodes / graph[2][:, :count].sum()
        word_loss = nn.functional.cross_entropy(scores.transpose(1, 2), words, reduction="none").sum(1).mean()
        return verdict_loss + word_loss


def graph_data(
    scenes: Sequence[Scene], product: Product, edges: EdgeKind, filter_m: float | None = None, crops: bool = False
) -> GraphData:
    """Graphs from the detections, labels from the truth."""
    graphs, graspable, words = [], [], []
    for scene in scenes:
        if len(scene.parts) > MAX_PARTS:
            raise ValueError(f"a scene of {len(scene.parts)} parts; at most {MAX_PARTS} fit into a graph")
        for required in range(len(scene.parts)):
            graph = scene_graph(scene.parts, required, product, edges, filter_m, crops)
            graphs.append(graph)
            free = [float(scene.graspable(index)) for index in graph.order]
            graspable.append(free + [0.0] * (MAX_PARTS - len(free)))
            words.append(encode(scene.solution(required), graph.order))
    return GraphData(
        torch.from_numpy(np.stack([graph.nodes for graph in graphs])),
        torch.from_numpy(np.stack([graph.weights for graph in graphs])),
        torch.from_numpy(np.stack([graph.present for graph in graphs])),
        torch.tensor(graspable, dtype=torch.float32),
        torch.tensor(words),
        torch.from_numpy(mirror_signs(product, crops)),
    )
