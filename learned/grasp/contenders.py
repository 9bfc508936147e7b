"""What the experiments compare: planners by name, how they learn, and the paper's own figures beside them."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import torch
from rich.console import Console

from cell.interfaces.planning import GraspPlanner
from cell.interfaces.product import Product
from learned.grasp.planner import PairwisePlanner, PaperPlanner
from learned.grasp.reference import AveragingPlanner
from learned.grasp.relations import RelationNet
from learned.grasp.rule import RulePlanner
from learned.grasp.scenes import Scene
from learned.grasp.settings import DetectionNoise, GripperGeometry, SceneSettings
from learned.grasp.torch_planners import RelationPlanner, TorchNetwork
from learned.grasp.train import (
    new_pairwise,
    new_paper,
    new_relations,
    train_pairwise,
    train_paper,
    train_relations,
    training_scenes,
)
from learned.grasp.training_settings import PairwiseSettings, PaperSettings, RelationSettings, TrainingSettings

_QUIET = Console(quiet=True)
PlannerFor = Callable[[DetectionNoise], GraspPlanner]

NO_MARGINS = GripperGeometry(margin_m=0.0, below_gap_m=0.0, hand_size_m=(0.100, 0.062))


@dataclass(frozen=True)
class Contender:
    """One row of a table.

    Attributes:
        title: how tables name it.
        settings: with which it learns; None where it has nothing to learn.
        seeds: with which it is trained in the experiments.
        paper: object accuracy for 1, 2, 3 required types in the paper's Table 2.
        iterative: success for 3, 4, 5, 6 parts in the paper's Table 3.
    """

    title: str
    settings: TrainingSettings | None = None
    seeds: tuple[int, ...] = (1,)
    paper: tuple[float, ...] = ()
    iterative: tuple[float, ...] = ()


SEEDS = (1, 2, 3)
_USUAL_SCENES = 427  # the paper's; epochs below are for so many
_PAPER = PaperSettings(observations=1, epochs=60)


def _variant(**changes: object) -> PaperSettings:
    return PaperSettings.model_validate(_PAPER.model_dump() | changes)


CONTENDERS = {
    "default": Contender("default: pairwise, signed distances", PairwiseSettings(observations=8, epochs=30), SEEDS),
    "rule": Contender("rule: analytic, with the skills' margins"),
    "rule0": Contender("rule without margins"),
    "average": Contender("reference: average over the known noise"),
    "paper": Contender(
        "WL-GNN + LSTM_Att, Eq. 4 normalised", _PAPER, SEEDS, (0.91, 0.891, 0.882), (0.91, 0.874, 0.782, 0.684)
    ),
    "printed": Contender("WL-GNN + LSTM_Att, Eq. 4 as printed", _variant(edges="printed"), paper=(0.91, 0.891, 0.882)),
    "lstm": Contender("WL-GNN + plain LSTM", _variant(attention=False), paper=(0.89, 0.872, 0.864)),
    "filter": Contender("distance filter .16", _variant(edges="none", filter_m=0.16), paper=(0.881, 0.843, 0.829)),
    "unweighted": Contender("no edge weights", _variant(edges="none"), paper=(0.634, 0.586, 0.545)),
    "crops": Contender(
        "WL-GNN + LSTM_Att, normalised, with crops' embeddings", _variant(data=SceneSettings(crops=True))
    ),
    "gcn": Contender("GCN_Att", _variant(edges="gcn"), paper=(0.421, 0.621, 0.692)),
    "relations": Contender("GVMRN_RF", RelationSettings(observations=1)),
}


def _for(settings: TrainingSettings, scenes: int) -> TrainingSettings:
    """The settings for another number of scenes: the more there are, the less often each is seen."""
    epochs = max(1, round(settings.epochs * math.sqrt(_USUAL_SCENES / scenes)))
    return settings.model_copy(update={"scenes": scenes, "epochs": min(epochs, 2 * settings.epochs)})


@dataclass
class Trainer:
    """Trains contenders once for each number of scenes and seed, and keeps them, in files where a folder is given."""

    product: Product
    folder: Path | None = None
    _kept: dict[tuple[str, int, int], torch.nn.Module] = field(default_factory=dict)

    def planner(self, name: str, scenes: int, seed: int) -> PlannerFor:
        """A planner for detections of any noise; only some ask for its level."""
        if name == "rule":
            return lambda _: RulePlanner(self.product)
        if name == "rule0":
            return lambda _: RulePlanner(self.product, NO_MARGINS)
        if name == "average":
            return lambda noise: AveragingPlanner(self.product, noise)
        settings = CONTENDERS[name].settings
        assert settings is not None
        net = self._net(name, _for(settings, scenes), seed)
        if isinstance(settings, PairwiseSettings):
            return lambda noise: PairwisePlanner(TorchNetwork(net, ("logits",)), self.product, noise)
        if isinstance(settings, PaperSettings):
            graph = settings.edges, settings.filter_m, settings.data.crops
            return lambda _: PaperPlanner(TorchNetwork(net, ("verdict", "words")), self.product, *graph)
        assert isinstance(net, RelationNet)
        return lambda _: RelationPlanner(net, self.product)

    def _net(self, name: str, settings: TrainingSettings, seed: int) -> torch.nn.Module:
        key = (name, settings.scenes, seed)
        if key not in self._kept:
            self._kept[key] = self._from_file(settings, seed)
        return self._kept[key]

    def _from_file(self, settings: TrainingSettings, seed: int) -> torch.nn.Module:
        """The network as it was trained before, or trained now."""
        identity = hashlib.sha256(f"{type(settings).__name__} {settings.model_dump_json()} {seed}".encode())
        path = None if self.folder is None else self.folder / f"{identity.hexdigest()[:24]}.pt"
        if path is not None and path.exists():
            net = self._untrained(settings)
            net.load_state_dict(torch.load(path, weights_only=True))
            return net.eval()
        net = self._trained(settings, training_scenes(self.product, seed, settings, _QUIET), seed)
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            torch.save(net.state_dict(), path.with_suffix(".partial"))
            path.with_suffix(".partial").replace(path)
        return net

    def _untrained(self, settings: TrainingSettings) -> torch.nn.Module:
        if isinstance(settings, PairwiseSettings):
            return new_pairwise(settings)
        if isinstance(settings, PaperSettings):
            return new_paper(self.product, settings)
        assert isinstance(settings, RelationSettings)
        return new_relations(self.product, settings)

    def _trained(self, settings: TrainingSettings, scenes: list[Scene], seed: int) -> torch.nn.Module:
        if isinstance(settings, PairwiseSettings):
            return train_pairwise(scenes, self.product, seed, settings, _QUIET)
        if isinstance(settings, PaperSettings):
            return train_paper(scenes, self.product, seed, settings, _QUIET)
        assert isinstance(settings, RelationSettings)
        return train_relations(scenes, self.product, seed, settings, _QUIET)
