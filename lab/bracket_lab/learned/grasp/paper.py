"""The paper's grasp planner in torch: features of crops, WL-GNN, graspability, LSTM with attention (Eq. 5-7)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn

from bracket_cell.learned.grasp.crops import EMBEDDING
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.grasp.footprints import MAP_PX, FootprintNet, Maps
from bracket_lab.learned.grasp.graph import MAX_PARTS, feature_count, scene_graph
from bracket_lab.learned.grasp.language import END, FIRST_TYPE, MAX_WORDS, encode, grammar
from bracket_lab.learned.grasp.scenes import Scene

_IMPOSSIBLE = -1e9


class GraphConvolution(nn.Module):
    """x_i' = W x_i + V sum_j e_ij x_j + b (Eq. 5), on dense batches."""

    def __init__(self, narrow: int, wide: int) -> None:
        super().__init__()
        self.own = nn.Linear(narrow, wide)
        self.neighbours = nn.Linear(narrow, wide, bias=False)

    def forward(self, nodes: Tensor, weights: Tensor) -> Tensor:
        """Nodes (b, n, narrow) and weights (b, n, n) to nodes (b, n, wide)."""
        updated: Tensor = self.own(nodes) + self.neighbours(weights @ nodes)
        return updated


class CropNet(nn.Module):
    """f_i: what a small convolutional network makes of the footprints that another one sees around a part.

    Attributes:
        footprints: trained before, and left as it is.
    """

    def __init__(self, types: int, channels: int = 16) -> None:
        super().__init__()
        self.footprints = FootprintNet(types).requires_grad_(False)
        wide = 2 * channels
        self.layers = nn.Sequential(
            nn.Conv2d(types, channels, 3, 2, 1),
            nn.ReLU(),
            nn.Conv2d(channels, wide, 3, 2, 1),
            nn.ReLU(),
            nn.Conv2d(wide, wide, 3, 2, 1),
            nn.ReLU(),
            nn.Flatten(),
            nn.Linear(wide * (MAP_PX // 8) ** 2, EMBEDDING),
            nn.ReLU(),
        )

    def forward(self, crops: Tensor) -> Tensor:
        """Embeddings (b, EMBEDDING) of crops (b, CHANNELS, CROP_PX, CROP_PX), bytes or numbers up to 255."""
        return self.of_maps(torch.sigmoid(self.footprints(crops)))

    def of_maps(self, maps: Tensor) -> Tensor:
        """Embeddings (b, EMBEDDING) of footprints (b, types, MAP_PX, MAP_PX) from 0 to 1."""
        embedding: Tensor = self.layers(maps)
        return embedding


class PaperNet(nn.Module):
    """Encoder, head and decoder; inputs are batches of padded scene graphs.

    Attributes:
        crops: makes the embeddings among the nodes' features; None for a network that has none.
    """

    def __init__(self, types: int, hidden: int, layers: int, features: int = 0, crops: bool = False) -> None:
        super().__init__()
        self.types = types
        self.crops = CropNet(types) if crops else None
        widths = [features] + [hidden] * layers
        self.convolutions = nn.ModuleList(GraphConvolution(narrow, wide) for narrow, wide in pairwise(widths))
        self.head = nn.Sequential(nn.Linear(2 * hidden, hidden), nn.ReLU(), nn.Linear(hidden, 1))
        self.decoder = Decoder(types, hidden)

    def encode(self, nodes: Tensor, weights: Tensor, present: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Nodes by Eq. 5, graspability of each by Eq. 6, and what the decoder is told of each.

        Returns:
            Embeddings of each node and of the graph together (b, n, 2 hidden); logits of graspability (b, n); what the
            decoder attends to (b, n, hidden + types + 1): embedding, label and graspability.
        """
        x = nodes
        for convolution in self.convolutions:
            x = torch.relu(convolution(x, weights)) * present[..., None]
        graph = x.sum(1) / present.sum(1, keepdim=True)
        both = torch.cat([x, graph[:, None].expand_as(x)], dim=-1)
        verdicts: Tensor = self.head(both).squeeze(-1)
        states = torch.cat([x, nodes[..., : self.types], torch.sigmoid(verdicts)[..., None]], dim=-1)
        return both, verdicts, states

    def forward(self, nodes: Tensor, weights: Tensor, present: Tensor) -> tuple[Tensor, Tensor]:
        """Logit (b,) that node 0 is graspable (Eq. 6), and word numbers (b, MAX_WORDS) of its solution."""
        both, verdicts, states = self.encode(nodes, weights, present)
        others = (nodes[:, 1:, : self.types] * present[:, 1:, None]).sum(1)
        return verdicts[:, 0], self.decoder.greedy(states, both[:, 0], present, others)


class Decoder(nn.Module):
    """LSTM that attends to the nodes at each word (Eq. 7): score h' W f."""

    grammar: Tensor

    def __init__(self, types: int, hidden: int) -> None:
        super().__init__()
        self.words, self.wide = FIRST_TYPE + types, hidden + types + 1
        self.begin = nn.Linear(2 * hidden, hidden)
        self.embedding = nn.Embedding(self.words + 1, hidden)
        self.cell = nn.LSTMCell(hidden + self.wide, hidden)
        self.key = nn.Linear(self.wide, hidden)
        self.word = nn.Linear(hidden + self.wide, self.words)
        self.register_buffer("grammar", torch.tensor(grammar(types), dtype=torch.float32), persistent=False)

    def forced(self, states: Tensor, asked: Tensor, present: Tensor, words: Tensor) -> Tensor:
        """Word logits (b, MAX_WORDS, words) about parts with embeddings (b, 2 hidden), with teacher forcing."""
        keys, state = self.key(states), self._start(asked)
        previous = torch.full_like(words[:, 0], self.words)
        logits = []
        for step in range(MAX_WORDS):
            scores, state = self._step(previous, states, keys, present, state)
            logits.append(scores)
            previous = words[:, step]
        return torch.stack(logits, dim=1)

    def greedy(self, states: Tensor, asked: Tensor, present: Tensor, others: Tensor) -> Tensor:
        """The likeliest word at each step (b, MAX_WORDS) among those that grammar and scene allow.

        Args:
            others: (b, types) how many parts of each type there are beside the one that is asked about.
        """
        keys, state = self.key(states), self._start(asked)
        previous = torch.full((len(asked),), self.words, dtype=torch.long)
        left = nn.functional.pad(others, (FIRST_TYPE, 0), value=float(MAX_WORDS + 1))
        words = []
        for _ in range(MAX_WORDS):
            scores, state = self._step(previous, states, keys, present, state)
            missing = (left < 0.5).to(scores.dtype) * _IMPOSSIBLE
            previous = (scores + self.grammar[previous] + missing).argmax(-1)
            left = left - nn.functional.one_hot(previous, self.words).to(left.dtype)
            words.append(previous)
        return torch.stack(words, dim=1)

    def _start(self, asked: Tensor) -> tuple[Tensor, Tensor]:
        hidden = torch.tanh(self.begin(asked))
        return hidden, torch.zeros_like(hidden)

    def _step(
        self, previous: Tensor, states: Tensor, keys: Tensor, present: Tensor, state: tuple[Tensor, Tensor]
    ) -> tuple[Tensor, tuple[Tensor, Tensor]]:
        context = self._context(state[0], states, keys, present)
        hidden, memory = self.cell(torch.cat([self.embedding(previous), context], dim=-1), state)
        return self.word(torch.cat([hidden, context], dim=-1)), (hidden, memory)

    def _context(self, hidden: Tensor, states: Tensor, keys: Tensor, present: Tensor) -> Tensor:
        energy = (keys * hidden[:, None]).sum(-1)
        attention = torch.softmax(energy + (1 - present) * _IMPOSSIBLE, dim=-1)
        return (attention[..., None] * states).sum(1)


@dataclass(frozen=True)
class GraphData:
    """Scenes with what is right for every part.

    Attributes:
        nodes: (scenes, MAX_PARTS, features without embeddings), no part being required yet.
        maps: (scenes, MAX_PARTS, types, MAP_PX, MAP_PX) bytes, footprints around each part; None where there are none.
        weights, present: as in SceneGraph.
        graspable: (scenes, MAX_PARTS).
        words: (scenes, MAX_PARTS, MAX_WORDS).
        types: of the product; the flag is the feature after them, then come x, y, cosine and sine.
    """

    nodes: Tensor
    maps: Tensor | None
    weights: Tensor
    present: Tensor
    graspable: Tensor
    words: Tensor
    types: int

    def __len__(self) -> int:
        return len(self.nodes)

    def loss(self, net: PaperNet, chosen: Tensor) -> Tensor:
        """Cross-entropy of all verdicts, and of the words about the required parts: some at random.

        Scenes are turned at random and half of them mirrored; footprints look alike from both ends of a part.
        """
        present = self.present[chosen]
        flags = (torch.rand(present.shape) < 0.5).float() * present
        flags[:, 0] = torch.where(flags.sum(1) == 0, torch.ones(()), flags[:, 0])
        nodes = self._turned(chosen, flags, net)
        both, verdicts, states = net.encode(nodes, self.weights[chosen], present)
        scene, part = torch.nonzero(flags, as_tuple=True)
        words = self.words[chosen][scene, part]
        scores = net.decoder.forced(states[scene], both[scene, part], present[scene], words)
        of_nodes = nn.functional.binary_cross_entropy_with_logits(
            verdicts, self.graspable[chosen], weight=present, reduction="sum"
        )
        said = nn.functional.cross_entropy(scores.transpose(1, 2), words, reduction="none").sum(1).mean()
        return of_nodes / present.sum() + said

    def _turned(self, chosen: Tensor, flags: Tensor, net: PaperNet) -> Tensor:
        """Nodes (b, n, features) of the chosen scenes, each turned by an angle and perhaps mirrored."""
        nodes, kinds = self.nodes[chosen].clone(), self.types
        angle = torch.rand(len(chosen), 1) * 2 * math.pi
        mirror = torch.where(torch.rand(len(chosen), 1) < 0.5, -1.0, 1.0)
        for place, times in ((kinds + 1, 1), (kinds + 3, 2)):
            x, y = nodes[..., place].clone(), nodes[..., place + 1].clone() * mirror
            cos, sin = torch.cos(times * angle), torch.sin(times * angle)
            nodes[..., place], nodes[..., place + 1] = x * cos - y * sin, x * sin + y * cos
        nodes[..., kinds] = flags
        if net.crops is None or self.maps is None:
            return nodes
        there = self.present[chosen] > 0
        maps = self.maps[chosen][there].to(torch.float32) / 255.0
        upside_down = (mirror < 0).expand_as(there)[there]
        half_turn = torch.rand(len(maps)) < 0.5
        maps = torch.where((upside_down ^ half_turn)[:, None, None, None], maps.flip(2), maps)
        maps = torch.where(half_turn[:, None, None, None], maps.flip(3), maps)
        embedding = nodes.new_zeros((*there.shape, EMBEDDING))
        embedding[there] = net.crops.of_maps(maps)
        return torch.cat([nodes, embedding], dim=-1)


def graph_data(scenes: Sequence[Scene], product: Product, maps: Sequence[Maps] | None = None) -> GraphData:
    """Graphs from the detections and the footprints around them, labels from the truth."""
    shape, names = (len(scenes), MAX_PARTS), list(product.parts)
    nodes = np.zeros((*shape, feature_count(product)), np.float32)
    weights, present = np.zeros((*shape, MAX_PARTS), np.float32), np.zeros(shape, np.float32)
    graspable, words = np.zeros(shape, np.float32), np.full((*shape, MAX_WORDS), END)
    around = None if maps is None else np.zeros((*shape, len(names), MAP_PX, MAP_PX), np.uint8)
    for k, scene in enumerate(scenes):
        if len(scene.parts) > MAX_PARTS:
            raise ValueError(f"a scene of {len(scene.parts)} parts; at most {MAX_PARTS} fit into a graph")
        graph = scene_graph(scene.parts, (0,), product)
        nodes[k], weights[k], present[k] = graph.nodes, graph.weights, graph.present
        types = [names.index(name) for name in scene.boxes.types]
        for place, part in enumerate(graph.order):
            graspable[k, place] = scene.graspable(part)
            words[k, place] = encode(scene.solution(part), types)
            if around is not None and maps is not None:
                around[k, place] = maps[k][part]
    seen = None if around is None else torch.from_numpy(around)
    edges_and_nodes = torch.from_numpy(weights), torch.from_numpy(present)
    labels = torch.from_numpy(graspable), torch.from_numpy(words)
    return GraphData(torch.from_numpy(nodes), seen, *edges_and_nodes, *labels, len(names))
