"""What the experiments compare: planners by name, how they learn, and the paper's own figures beside them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

from torch import nn

from cell.interfaces.planning import GraspPlanner
from cell.interfaces.product import Product
from learned.grasp.planner import PairwisePlanner, PaperPlanner
from learned.grasp.reference import AveragingPlanner
from learned.grasp.relations import RelationNet, RelationPlanner
from learned.grasp.rule import RulePlanner
from learned.grasp.settings import DetectionNoise, GripperOutline, SceneSettings
from learned.grasp.train import OUTPUTS, model_card, train_network, training_scenes
from learned.grasp.training_settings import PairwiseSettings, PaperSettings, RelationSettings, TrainingSettings
from learned.torch_model import TorchModel

NO_MARGINS = GripperOutline(fitting_m=0.0)


@dataclass(frozen=True)
class Baseline:
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


BASELINES = {
    "default": Baseline(
        "default: pairwise, signed distances", PairwiseSettings(observations=8, epochs=30, random_share=0.0), SEEDS
    ),
    "rule": Baseline("rule: analytic, with the skills' margins"),
    "rule0": Baseline("rule without margins"),
    "average": Baseline("reference: average over the known noise"),
    "paper": Baseline(
        "WL-GNN + LSTM_Att, Eq. 4 normalised", _PAPER, SEEDS, (0.91, 0.891, 0.882), (0.91, 0.874, 0.782, 0.684)
    ),
    "printed": Baseline("WL-GNN + LSTM_Att, Eq. 4 as printed", _variant(edges="printed"), paper=(0.91, 0.891, 0.882)),
    "lstm": Baseline("WL-GNN + plain LSTM", _variant(attention="none"), paper=(0.89, 0.872, 0.864)),
    "filter": Baseline("distance filter .16", _variant(edges="none", filter_m=0.16), paper=(0.881, 0.843, 0.829)),
    "unweighted": Baseline("no edge weights", _variant(edges="none"), paper=(0.634, 0.586, 0.545)),
    "crops": Baseline(
        "WL-GNN + LSTM_Att, normalised, with crops' embeddings", _variant(data=SceneSettings(crops=True))
    ),
    "gcn": Baseline("GCN_Att", _variant(edges="gcn"), paper=(0.421, 0.621, 0.692)),
    "relations": Baseline("GVMRN_RF", RelationSettings(observations=1)),
}


def planner_of(name: str, product: Product, scenes: int, seed: int, noise: DetectionNoise) -> GraspPlanner:
    """A planner, trained on so many scenes where it learns; `noise` is that of the detections, if it asks for it."""
    if name == "rule":
        return RulePlanner(product)
    if name == "rule0":
        return RulePlanner(product, NO_MARGINS)
    if name == "average":
        return AveragingPlanner(product, noise)
    settings = BASELINES[name].settings
    assert settings is not None
    return trained_planner(_for(settings, scenes), product, seed, noise)


def trained_planner(
    settings: TrainingSettings, product: Product, seed: int, noise: DetectionNoise | None = None
) -> GraspPlanner:
    """A planner that was trained with these settings."""
    network = _trained(settings, product.model_dump_json(), seed)
    if isinstance(network, RelationNet):
        return RelationPlanner(network, product)
    kind = "pairwise" if isinstance(settings, PairwiseSettings) else "paper"
    model = TorchModel(network, OUTPUTS[kind], model_card(kind, product, settings, seed, data_sha256="", command=""))
    return PairwisePlanner(model, product, noise) if kind == "pairwise" else PaperPlanner(model, product)


def _for(settings: TrainingSettings, scenes: int) -> TrainingSettings:
    """The settings for another number of scenes: the more there are, the less often each is seen."""
    epochs = max(1, round(settings.epochs * math.sqrt(_USUAL_SCENES / scenes)))
    return settings.model_copy(update={"scenes": scenes, "epochs": min(epochs, 2 * settings.epochs)})


@lru_cache(maxsize=16)
def _trained(settings: TrainingSettings, product: str, seed: int) -> nn.Module:
    """Trained once for all cells that ask for it."""
    catalogue, scenes = training_scenes(Product.model_validate_json(product), seed, settings)
    return train_network(scenes, catalogue, seed, settings)
