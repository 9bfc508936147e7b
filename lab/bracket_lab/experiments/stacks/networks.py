"""Heads over frozen features: VMRN, GVMRN-RF, and a graph network whose decoder points at nodes. Imports torch."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from bracket_lab.experiments.stacks.batches import GEOMETRY, MOST_ON_TOP, NOTHING, Answers, Batch
from bracket_lab.learned.grasp.paper import GraphConvolution, PaperNet

POINTED = 128  # width of the default's layers
SHORT = 48  # what a node keeps of a region's features
PAPER_GRAPH = 96, 2  # width and convolutions of the paper's network
_NEVER = -1e9


class PairLayer(nn.Module):
    """A layer over regions of both objects and of their union; what it makes of a region is worked out once."""

    def __init__(self, features: int, hidden: int) -> None:
        super().__init__()
        self.first = nn.Linear(features, hidden)
        self.second, self.union = (nn.Linear(features, hidden, bias=False) for _ in range(2))

    def forward(self, batch: Batch, there: Tensor) -> Tensor:
        """(pairs, hidden) of the pairs that are there (b, n, n)."""
        scene, i, j = there.nonzero(as_tuple=True)
        both = self.first(batch.regions)[scene, i] + self.second(batch.regions)[scene, j]
        joined: Tensor = both + self.union(batch.unions[scene, i, j])
        return joined


class Vmrn(nn.Module):
    """Zhang et al. 2018: regions of both objects and of their union, two layers of FC, BN, ReLU, then three classes."""

    def __init__(self, features: int, hidden: int) -> None:
        super().__init__()
        self.enter = PairLayer(features, hidden)
        self.layers = nn.Sequential(*_normed(hidden), nn.Linear(hidden, hidden), *_normed(hidden), nn.Linear(hidden, 3))

    def forward(self, batch: Batch) -> Tensor:
        """Logits (b, n, n, 3) of FATHER, CHILD, NOTHING; both orders averaged."""
        there = pairs_there(batch)
        logits = batch.unions.new_zeros((*there.shape, 3))
        if there.any():
            logits[there] = self.layers(self.enter(batch, there))
        return (logits + turned(logits)) / 2

    def loss(self, batch: Batch, answers: Answers) -> Tensor:
        """Cross-entropy of all pairs."""
        return relation_loss(self(batch), batch, answers)


class GvmrnRf(nn.Module):
    """Zuo et al. 2021: nodes are pairs with their union; those that a filter finds related tell each other."""

    def __init__(self, features: int, hidden: int) -> None:
        super().__init__()
        self.enter, self.filter = PairLayer(features, hidden), nn.Linear(hidden, 1)
        self.convolutions = nn.ModuleList(GraphConvolution(hidden, hidden) for _ in range(2))
        self.leave = nn.Linear(2 * hidden, 3)

    def forward(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Logits (b, n, n, 3) of relations, and (b, n, n) that there is one."""
        count, there = batch.present.shape[1], pairs_there(batch)
        entered = batch.unions.new_zeros((*there.shape, self.filter.in_features))
        entered[there] = torch.relu(self.enter(batch, there))
        related = self.filter(entered).squeeze(-1)
        related = (related + related.transpose(1, 2)) / 2
        kept = torch.sigmoid(related) * there
        nodes, passed = entered.flatten(1, 2), kept.flatten(1)
        links = _shared(count, nodes) * passed[:, None] * passed[:, :, None]
        links = links / links.sum(-1, keepdim=True).clamp(min=1e-6)
        x = nodes
        for convolution in self.convolutions:
            x = torch.relu(convolution(x, links))
        logits = self.leave(torch.cat([nodes, x], dim=-1)).unflatten(1, (count, count))
        return (logits + turned(logits)) / 2, related

    def loss(self, batch: Batch, answers: Answers) -> Tensor:
        """Cross-entropy of all pairs and of the filter."""
        logits, related = self(batch)
        there = pairs_there(batch)
        wanted = (answers.relations != NOTHING).float()
        filtered = nn.functional.binary_cross_entropy_with_logits(related[there], wanted[there])
        return relation_loss(logits, batch, answers) + filtered


class PointerNet(nn.Module):
    """WL-GNN (Eq. 5) whose messages know the union of two boxes; graspability, and a decoder that points at nodes."""

    def __init__(self, features: int, classes: int, hidden: int = POINTED, rounds: int = 2) -> None:
        super().__init__()
        self.short = nn.Sequential(nn.Linear(features, SHORT), nn.ReLU(), nn.Dropout(0.3))
        self.short_union = nn.Sequential(nn.Linear(features, SHORT), nn.ReLU(), nn.Dropout(0.3))
        self.node = nn.Linear(SHORT + classes + 4, hidden)
        self.pair = nn.Sequential(
            nn.Linear(2 * hidden + SHORT + GEOMETRY, hidden), nn.ReLU(), nn.Linear(hidden, hidden), nn.ReLU()
        )
        self.own = nn.ModuleList(nn.Linear(hidden, hidden) for _ in range(rounds))
        self.sent = nn.ModuleList(nn.Linear(2 * hidden, hidden, bias=False) for _ in range(rounds))
        self.relation = nn.Linear(3 * hidden, 3)
        self.verdict = nn.Sequential(nn.Linear(2 * hidden, hidden), nn.ReLU(), nn.Linear(hidden, 1))
        self.begin = nn.Linear(hidden, hidden)
        self.cell = nn.GRUCell(hidden, hidden)
        self.query, self.key = nn.Linear(hidden, hidden), nn.Linear(3 * hidden, hidden)
        self.score, self.stop = nn.Linear(hidden, 1), nn.Linear(hidden, 1)

    def encode(self, batch: Batch) -> tuple[Tensor, Tensor, Tensor]:
        """Nodes (b, n, h) by Eq. 5 with pairs in the messages, pairs (b, n, n, 3 h), logits of graspability (b, n)."""
        count, there = batch.present.shape[1], pairs_there(batch).float()
        x = torch.relu(self.node(torch.cat([self.short(batch.regions), batch.labels, batch.boxes], dim=-1)))
        first = x[:, :, None].expand(-1, -1, count, -1)
        facts = [first, first.transpose(1, 2), self.short_union(batch.unions), batch.pairs]
        pair = self.pair(torch.cat(facts, dim=-1)) * there[..., None]
        for own, sent in zip(self.own, self.sent, strict=True):
            message = sent(torch.cat([x[:, None].expand(-1, count, -1, -1), pair], dim=-1))
            x = torch.relu(own(x) + (torch.relu(message) * there[..., None]).sum(2)) * batch.present[..., None]
        first = x[:, :, None].expand(-1, -1, count, -1)
        both = torch.cat([first, first.transpose(1, 2), pair], dim=-1)
        most = pair.amax(2)
        return x, both, self.verdict(torch.cat([x, most], dim=-1)).squeeze(-1)

    def forward(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Logits (b, n) that each object can be taken, and (b, n, words) what before it; n says: no more."""
        nodes, both, verdicts = self.encode(batch)
        size, count = batch.present.shape
        state = torch.tanh(self.begin(nodes)).flatten(0, 1)
        keys, free = self._keys(both), self._free(batch)
        words = []
        for _ in range(min(MOST_ON_TOP, count)):
            scores = self._scores(state, keys, free)
            word = scores.argmax(-1)
            words.append(word.view(size, count))
            free = free.scatter(1, word[:, None], 0.0)
            free[:, -1] = 1.0
            state = self._step(state, keys, word)
        return verdicts, torch.stack(words, dim=-1)

    def loss(self, batch: Batch, answers: Answers) -> Tensor:
        """Cross-entropy of verdicts, of relations, and of the words under teacher forcing."""
        nodes, both, verdicts = self.encode(batch)
        count = batch.present.shape[1]
        there = batch.present > 0
        of_nodes = nn.functional.binary_cross_entropy_with_logits(verdicts[there], answers.graspable[there])
        logits = self.relation(both)
        of_pairs = relation_loss((logits + turned(logits)) / 2, batch, answers)
        state, keys, free = torch.tanh(self.begin(nodes)).flatten(0, 1), self._keys(both), self._free(batch)
        words = torch.where(answers.order < 0, count, answers.order).flatten(0, 1)
        ended = torch.zeros(len(words), dtype=torch.bool)
        longest = int((answers.order >= 0).sum(-1).max())
        said = []
        for step in range(min(MOST_ON_TOP, longest + 1)):
            word = words[:, step]
            each = nn.functional.cross_entropy(self._scores(state, keys, free), word, reduction="none")
            said.append(each * ~ended)
            ended = ended | (word == count)
            free = free.scatter(1, word[:, None], 0.0)
            free[:, -1] = 1.0
            state = self._step(state, keys, word)
        of_words = torch.stack(said).sum(0)[there.flatten()].mean()
        return of_nodes + of_pairs + of_words

    def _keys(self, both: Tensor) -> Tensor:
        """(b n, n, h) of each node as seen from each one that is asked about."""
        keys: Tensor = self.key(both).flatten(0, 1)
        return keys

    def _free(self, batch: Batch) -> Tensor:
        """(b n, n + 1) 1 for what may be pointed at; the last says that nothing more is in the way."""
        there = pairs_there(batch).float().flatten(0, 1)
        return nn.functional.pad(there, (0, 1), value=1.0)

    def _scores(self, state: Tensor, keys: Tensor, free: Tensor) -> Tensor:
        pointed = self.score(torch.tanh(self.query(state)[:, None] + keys)).squeeze(-1)
        scores = torch.cat([pointed, self.stop(state)], dim=-1)
        return scores + (1 - free) * _NEVER

    def _step(self, state: Tensor, keys: Tensor, word: Tensor) -> Tensor:
        padded = nn.functional.pad(keys, (0, 0, 0, 1))
        chosen = padded[torch.arange(len(word)), word]
        stepped: Tensor = self.cell(chosen, state)
        return stepped


class WordNet(nn.Module):
    """The paper's: WL-GNN over v_i = {f_i, l_i, g_i} with the weights of Eq. 4, LSTM with attention over words."""

    def __init__(self, features: int, classes: int) -> None:
        super().__init__()
        hidden, layers = PAPER_GRAPH
        self.short = nn.Sequential(nn.Linear(features, SHORT), nn.ReLU(), nn.Dropout(0.3))
        self.net = PaperNet(classes, hidden, layers, features=classes + 1 + 4 + SHORT)

    def nodes(self, batch: Batch, flags: Tensor) -> Tensor:
        """v_i, and the box (b, n, features)."""
        facts = [batch.labels, flags[..., None], batch.boxes, self.short(batch.regions)]
        return torch.cat(facts, dim=-1) * batch.present[..., None]


def relation_loss(logits: Tensor, batch: Batch, answers: Answers) -> Tensor:
    """Cross-entropy of all ordered pairs."""
    there = pairs_there(batch)
    if not there.any():
        return logits.sum() * 0.0
    return nn.functional.cross_entropy(logits[there], answers.relations[there])


def pairs_there(batch: Batch) -> Tensor:
    """(b, n, n) whether both objects are there, and are two."""
    both = batch.present[:, :, None] * batch.present[:, None]
    return (both * (1 - torch.eye(batch.present.shape[1]))).bool()


def turned(logits: Tensor) -> Tensor:
    """Logits (b, n, n, 3) of the pairs in the other order, told of this one: father and child change places."""
    return logits.transpose(1, 2)[..., [1, 0, 2]]


def _normed(wide: int) -> tuple[nn.Module, ...]:
    return nn.BatchNorm1d(wide), nn.ReLU()


def _shared(count: int, like: Tensor) -> Tensor:
    """(n n, n n) 1 where two pairs share an object."""
    first = torch.arange(count).repeat_interleave(count)
    second = torch.arange(count).repeat(count)
    shared = (first[:, None] == first) | (first[:, None] == second)
    shared = shared | (second[:, None] == first) | (second[:, None] == second)
    return shared.to(like.dtype)
