"""What the experiments compare: planners by name, how they learn, and the paper's own figures beside them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial

import numpy as np
from torch import nn

from bracket_cell.learned.grasp.boxes import Blocks, Boxes, boxes_of, rectangles_overlap
from bracket_cell.learned.grasp.candidates import graspable, touching
from bracket_cell.learned.grasp.crops import CROPS_KIND, TrayCamera
from bracket_cell.learned.grasp.model import PairwisePlanner, RulePlanner
from bracket_cell.learned.grasp.pairs import as_in_catalogue
from bracket_cell.learned.grasp.settings import (
    WITH_MARGINS,
    DetectionNoise,
    GripperOutline,
    PairwiseSettings,
    PaperSettings,
    SceneSettings,
    TrainingSettings,
)
from bracket_cell.learned.grasp.solution import Solution, nearest_first, solve, solves
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.planning import GraspPlan, GraspPlanner
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product
from bracket_lab.experiments.paper.relations import RelationNet, RelationPlanner, RelationSettings, untrained_relations
from bracket_lab.learned.grasp.evaluate import Look, embedded
from bracket_lab.learned.grasp.footprints import FootprintNet, fit_footprints
from bracket_lab.learned.grasp.paper import PaperNet
from bracket_lab.learned.grasp.paper_planner import PaperPlanner
from bracket_lab.learned.grasp.train import OUTPUTS, model_card, train_network, training_scenes
from bracket_lab.learned.training.torch_model import TorchModel

_TRIES_FOR_EACH = 8  # draws for each scene that is kept, the most possible ones


class AveragingPlanner:
    """A Monte Carlo average over the known noise."""

    def __init__(self, product: Product, noise: DetectionNoise, draws: int = 40, nearest_gap_m: float = 0.003) -> None:
        self._product = product
        self._noise = noise
        self._draws = draws
        self._gap_m = nearest_gap_m
        self._outline = GripperOutline()
        self._seen: tuple[PartDetection, ...] | None = None
        self._possible: list[Blocks] = []

    def plan(self, parts: tuple[PartDetection, ...], required: int) -> GraspPlan:
        """The answer that is right in most of the scenes that the detections allow."""
        boxes = as_in_catalogue(boxes_of(parts, self._product), self._product)
        if self._seen is not parts:
            self._seen, self._possible = parts, self._draw(boxes)
        order = nearest_first(boxes, required)
        solutions = Counter(solve(blocks, required, order) for blocks in self._possible)
        best = max(solutions, key=lambda solution: _votes(solution, self._possible, required))
        share = np.mean([graspable(blocks)[required] for blocks in self._possible])
        return best.plan(float(share))

    def _draw(self, boxes: Boxes) -> list[Blocks]:
        rng = np.random.default_rng(len(boxes))
        noise, count = self._noise, len(boxes)
        drawn = [
            replace(
                boxes,
                centre_m=boxes.centre_m + rng.normal(0.0, noise.position_m, (count, 2)),
                yaw_rad=boxes.yaw_rad + rng.normal(0.0, noise.yaw_rad, count),
            )
            for _ in range(_TRIES_FOR_EACH * self._draws)
        ]
        overlaps = _overlaps(drawn, self._gap_m)
        return [touching(drawn[k], self._outline) for k in np.argsort(overlaps, kind="stable")[: self._draws]]


def _overlaps(drawn: Sequence[Boxes], gap_m: float) -> Array:
    """(draws,) how many bodies come nearer to each other than a gap; all draws have the same bodies."""
    centre = np.stack([boxes.centre_m for boxes in drawn])
    yaw = np.stack([boxes.yaw_rad for boxes in drawn])
    half = drawn[0].size_m[:, :2] / 2
    overlap = rectangles_overlap(
        centre[:, :, None], yaw[:, :, None], half[:, None] + gap_m, centre[:, None], yaw[:, None], half
    )
    found: Array = overlap.sum(axis=(1, 2))
    return found


def _votes(solution: Solution, possible: Sequence[Blocks], required: int) -> int:
    if solution.needs_help:
        return sum(solve(blocks, required, range(len(blocks))).needs_help for blocks in possible)
    return sum(solves(solution.moves, blocks, required) for blocks in possible)


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


@dataclass(frozen=True)
class TrainedBaseline:
    """A planner, and what the detector must add to the scenes that it is asked about."""

    planner: GraspPlanner
    look: Look = list


class Constant:
    """Gives one answer to everything."""

    def __init__(self, plan: GraspPlan) -> None:
        self._plan = plan

    def plan(self, parts: tuple[PartDetection, ...], required: int) -> GraspPlan:  # noqa: ARG002
        """The answer."""
        return self._plan


SEEDS = (1, 2, 3)
USUAL_SCENES = 427  # the paper's; epochs below are for this number
CONSTANT = {"always": GraspPlan(1.0, (), False, "grasp"), "help": GraspPlan(0.0, (), True, "help")}
_PAPER = PaperSettings(scenes=USUAL_SCENES, epochs=300, loose_share=0.0)


def _variant(**changes: object) -> PaperSettings:
    return PaperSettings.model_validate(_PAPER.model_dump() | changes)


BASELINES = {
    "always": Baseline('always "grasp"'),
    "help": Baseline('always "help"'),
    "default": Baseline(
        "default: pairwise, signed distances", PairwiseSettings(observations=8, epochs=30, random_share=0.0), SEEDS
    ),
    "rule": Baseline("rule: analytic, with the skills' margins"),
    "rule0": Baseline("rule without margins"),
    "average": Baseline("reference: average over the known noise"),
    "paper": Baseline("WL-GNN + LSTM_Att", _PAPER, SEEDS, (0.91, 0.891, 0.882), (0.91, 0.874, 0.782, 0.684)),
    "printed": Baseline("Eq. 4 as printed", _variant(edges="printed"), paper=(0.91, 0.891, 0.882)),
    "additive": Baseline("additive attention", _variant(attention="additive")),
    "lstm": Baseline("WL-GNN + plain LSTM", _variant(attention="none"), paper=(0.89, 0.872, 0.864)),
    "filter": Baseline("distance filter .16", _variant(edges="none", filter_m=0.16), paper=(0.881, 0.843, 0.829)),
    "unweighted": Baseline("no edge weights", _variant(edges="none"), paper=(0.634, 0.586, 0.545)),
    "gcn": Baseline("GCN_Att", _variant(edges="gcn"), paper=(0.421, 0.621, 0.692)),
    "poses": Baseline("WL-GNN + LSTM_Att without f_i, poses alone", _variant(crops=False)),
    "relations": Baseline("GVMRN_RF, pairs whose boxes meet", RelationSettings(observations=1)),
    "near": Baseline("GVMRN_RF, pairs nearer than .12 m", RelationSettings(observations=1, filter="distance")),
}


def trained_baseline(
    name: str,
    product: Product,
    camera: TrayCamera,
    scenes: int,
    seed: int,
    noise: DetectionNoise,
    data: SceneSettings,
) -> TrainedBaseline:
    """A planner, trained on a number of scenes if it learns.

    Args:
        noise: of the detections, if the planner asks for it.
        data: how the scenes are drawn that it learns from, and what can be grasped in them.
    """
    if name in CONSTANT:
        return TrainedBaseline(Constant(CONSTANT[name]))
    one_way = {"one_way": data.outline.one_way}
    if name == "rule":
        return TrainedBaseline(RulePlanner(product, WITH_MARGINS.model_copy(update=one_way)))
    if name == "rule0":
        return TrainedBaseline(RulePlanner(product, data.outline.model_copy(update={"fitting_m": 0.0})))
    if name == "average":
        return TrainedBaseline(AveragingPlanner(product, noise))
    settings = BASELINES[name].settings
    assert settings is not None
    learned = _for(settings, scenes).model_copy(update={"data": data, "parts": data.parts})
    network = _trained(learned, product.model_dump_json(), seed, camera)
    return _asked(network, learned, product, seed, noise, data.outline, camera)


def _asked(
    network: nn.Module,
    settings: TrainingSettings,
    product: Product,
    seed: int,
    noise: DetectionNoise,
    outline: GripperOutline,
    camera: TrayCamera,
) -> TrainedBaseline:
    """A trained network as a planner."""
    if isinstance(settings, RelationSettings):
        assert isinstance(network, RelationNet)
        return TrainedBaseline(RelationPlanner(network, product, settings.filter, outline))
    kind = "pairwise" if isinstance(settings, PairwiseSettings) else "paper"
    card = model_card(kind, product, settings, seed, data_sha256="", command="")
    model = TorchModel(network, OUTPUTS[kind], card)
    if not isinstance(network, PaperNet):
        return TrainedBaseline(PairwisePlanner(model, product, noise, outline))
    if network.crops is None:
        return TrainedBaseline(PaperPlanner(model, product))
    crops = TorchModel(network.crops, ("embedding",), card.model_copy(update={"kind": CROPS_KIND}))
    return TrainedBaseline(PaperPlanner(model, product), partial(embedded, camera=camera, network=crops))


def _for(settings: TrainingSettings, scenes: int) -> TrainingSettings:
    """The settings for another number of scenes: the more there are, the less often each is seen."""
    epochs = max(1, round(settings.epochs * math.sqrt(USUAL_SCENES / scenes)))
    return settings.model_copy(update={"scenes": scenes, "epochs": min(epochs, 2 * settings.epochs)})


@lru_cache(maxsize=16)
def _trained(settings: TrainingSettings, product: str, seed: int, camera: TrayCamera) -> nn.Module:
    """Trained once for all cells that ask for it."""
    catalogue, scenes = training_scenes(Product.model_validate_json(product), seed, settings)
    footprints = None
    if isinstance(settings, PaperSettings) and settings.crops:
        alike = settings.model_dump(include={"scenes", "data", "parts", "loose_share", "footprint_passes"})
        footprints = _footprints(PaperSettings.model_validate(alike), product, seed, camera)
    untrained = untrained_relations if isinstance(settings, RelationSettings) else None
    return train_network(scenes, catalogue, seed, settings, camera=camera, footprints=footprints, untrained=untrained)


@lru_cache(maxsize=4)
def _footprints(settings: PaperSettings, product: str, seed: int, camera: TrayCamera) -> FootprintNet:
    """Trained once for all baselines that learn from the same scenes."""
    catalogue, scenes = training_scenes(Product.model_validate_json(product), seed, settings)
    crops = camera([(scene.boxes, scene.parts) for scene in scenes])
    return fit_footprints(crops, scenes, list(catalogue.parts), seed, settings.footprint_passes)
