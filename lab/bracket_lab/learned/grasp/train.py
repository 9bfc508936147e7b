"""Training of the grasp planners on drawn or recorded scenes, in minutes on a CPU, and export to ONNX."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from torch import Tensor, nn

from bracket_cell.learned.grasp.boxes import boxes_of
from bracket_cell.learned.grasp.candidates import CANDIDATES, as_headed, available
from bracket_cell.learned.grasp.crops import CHANNELS, CROP_PX, CROPS_KIND, TrayCamera, load_crops
from bracket_cell.learned.grasp.pairs import PAIR_FEATURES, near_pairs, pair_features
from bracket_cell.learned.grasp.settings import (
    TRAY_SCENES,
    GripperOutline,
    PairwiseSettings,
    PaperSettings,
    TrainingSettings,
)
from bracket_cell.learned.inference.onnx_model import ModelCard, Network
from bracket_ground.errors import InputError
from bracket_ground.interfaces.planning import crops_file
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.grasp.evaluate import Look, embedded, evaluate_grasp, evaluate_scenes
from bracket_lab.learned.grasp.footprints import FootprintNet, fit_footprints
from bracket_lab.learned.grasp.graph import MAX_PARTS, feature_count
from bracket_lab.learned.grasp.language import words_of
from bracket_lab.learned.grasp.noise_augmentation import SCENES_EACH, observed_again, random_scenes, with_random_parts
from bracket_lab.learned.grasp.paper import PaperNet, graph_data
from bracket_lab.learned.grasp.paper_planner import load_grasp_planner
from bracket_lab.learned.grasp.scenes import Scene, data_hash, draw_scenes
from bracket_lab.learned.training.recipe import Recipe, Task
from bracket_lab.learned.training.torch_model import TorchModel, write_weights


class PairNet(nn.Module):
    """A small committee of perceptrons over the features of one pair; their logits are averaged."""

    def __init__(self, hidden: int, members: int) -> None:
        super().__init__()
        self.members = nn.ModuleList(_perceptron(hidden) for _ in range(members))

    def forward(self, pairs: Tensor) -> Tensor:
        """Logits (...) of features (..., PAIR_FEATURES)."""
        return self.each(pairs).mean(0)

    def each(self, pairs: Tensor) -> Tensor:
        """Logits (members, ...) of every member."""
        return torch.stack([member(pairs).squeeze(-1) for member in self.members])


@dataclass(frozen=True)
class PairData:
    """All parts of many scenes with their candidates and neighbours, padded to the largest scene (n parts).

    Attributes:
        features: (parts, candidates, n, PAIR_FEATURES).
        blocks: (parts, candidates, n) 1 where the neighbour blocks the candidate.
        present: (parts, candidates, n) 1 where there are such a candidate and such a neighbour within reach.
    """

    features: Tensor
    blocks: Tensor
    present: Tensor

    def __len__(self) -> int:
        return len(self.features)

    def loss(self, net: PairNet, chosen: Tensor) -> Tensor:
        """Cross-entropy of every pair, and of the noisy-or over a candidate's neighbours; summed over the members."""
        logits = net.each(self.features[chosen])
        blocks, present = self.blocks[chosen], self.present[chosen]
        pairs = nn.functional.binary_cross_entropy_with_logits(logits, blocks.expand_as(logits), reduction="none")
        free = (nn.functional.logsigmoid(-logits) * present).sum(-1)
        blocked = (blocks * present).amax(-1).expand_as(free)
        # log(1 - exp(free)) without loss of precision; the bound keeps it finite where nothing is near.
        log_blocked = torch.log(-torch.expm1(free.clamp(max=-1e-6)))
        candidates = -(blocked * log_blocked + (1 - blocked) * free) * present.amax(-1)
        each = (pairs * present).sum((1, 2, 3)).sum() / present.sum()
        return each + candidates.sum() / present.amax(-1).sum()


def pair_data(scenes: Sequence[Scene], product: Product) -> PairData:
    """Features from the detections, labels from the truth."""
    widest = max(len(scene.boxes) for scene in scenes)
    shape = (sum(len(scene.boxes) for scene in scenes), len(CANDIDATES), widest)
    features = np.zeros((*shape, PAIR_FEATURES), dtype=np.float32)
    blocks, present = np.zeros((2, *shape), dtype=np.float32)
    first = 0
    for scene in scenes:
        boxes = boxes_of(scene.parts, product)
        pairs = near_pairs(boxes, available(boxes, GripperOutline()))
        places = first + pairs.part, pairs.candidate, pairs.neighbour
        features[places] = pair_features(boxes, pairs, product, scene.noise)
        truth = as_headed(scene.blocks, scene.boxes, boxes)
        blocks[places] = truth[pairs.part, pairs.candidate, pairs.neighbour]
        present[places] = 1.0
        first += len(boxes)
    return PairData(torch.from_numpy(features), torch.from_numpy(blocks), torch.from_numpy(present))


def _perceptron(hidden: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(PAIR_FEATURES, hidden), nn.SiLU(), nn.Linear(hidden, hidden), nn.SiLU(), nn.Linear(hidden, 1)
    )


OUTPUTS = {"pairwise": ("logits",), "paper": ("verdict", "words")}
_LOOSE_SEED = 500_000  # apart from the seeds of the other scenes
_TEST_SHARE = 0.2  # of given scenes, kept for the scores


def train_grasp(
    product: Product,
    out: Path,
    seed: int,
    kind: str,
    *,
    settings: TrainingSettings | None = None,
    scenes: Sequence[Scene] | None = None,
    camera: TrayCamera | None = None,
    quiet: bool = False,
    command: str = "",
) -> dict[str, float]:
    """Train, write the weights with their model card, and score the written file on scenes that were kept apart.

    Args:
        out: the ONNX file; beside it an interrupted training is kept to go on from.
        kind: "pairwise" or "paper".
        settings: of that kind; its defaults where None.
        scenes: to learn from, one in five of them kept for the scores; drawn ones where None.
        camera: takes the images of the scenes; the paper's planner learns from them.
        quiet: no progress bar.
        command: what was typed, for the model card.

    Returns:
        Scores by name, the same as on the model card.

    Raises:
        InputError: `kind` is not one that can be trained, or too few scenes are given.
    """
    if kind not in OUTPUTS:
        raise InputError(f"no grasp planner {kind!r} can be trained; legal: {', '.join(OUTPUTS)}")
    settings = settings or (PairwiseSettings() if kind == "pairwise" else PaperSettings())
    test: list[Scene] = []
    if scenes is None:
        catalogue, learned = training_scenes(product, seed, settings, quiet=quiet)
        split = f"{len(learned)} scenes of the train split; scores on {settings.test_scenes} of the test split"
    else:
        catalogue, (learned, test) = product, split_by_run(scenes, seed)
        split = f"{len(learned)} given scenes; scores on {len(test)} others of them, of other runs"
    words = command or f"train_grasp(kind={kind!r}, seed={seed})"
    task = Task(out=out, seed=seed, command=words, quiet=quiet)
    recipe = replace(grasp_recipe(learned, catalogue, settings, task, camera=camera), more={"split": split})
    recipe = replace(recipe, vocabulary=vocabulary_of(product))
    recipe.fit(task)
    network, card = recipe.network, recipe.card(task)

    look = _look_of(network, out, card, camera)

    def score() -> dict[str, float]:
        planner = load_grasp_planner(kind, out, product)
        if test:
            return evaluate_scenes(planner, look(test), seed)
        return evaluate_grasp(planner, product, seed, settings.test_scenes, settings.data, look=look)

    scores = recipe.write(task, OUTPUTS[kind], _samples(settings, product), score, any_rows=True)
    _footprints_of(out).unlink(missing_ok=True)
    return scores


def _look_of(network: nn.Module, out: Path, card: ModelCard, camera: TrayCamera | None) -> Look:
    """How scenes are seen for the scores: by the written network of the crops, where the planner has one."""
    if not isinstance(network, PaperNet) or network.crops is None:
        return list
    assert camera is not None
    return partial(embedded, camera=camera, network=_write_crops(network.crops, crops_file(out), card))


def _write_crops(network: nn.Module, out: Path, card: ModelCard) -> Network:
    """Export the network of the crops, beside the planner that reads its embeddings."""
    images = np.random.default_rng(0).integers(0, 256, (3, CHANNELS, CROP_PX, CROP_PX), np.uint8)
    own = card.model_copy(update={"kind": CROPS_KIND})
    write_weights(TorchModel(network, ("embedding",), own), out, [{"crops": images}], dict, any_rows=True)
    return load_crops(out)


def training_scenes(
    product: Product, seed: int, settings: TrainingSettings, *, quiet: bool = True
) -> tuple[Product, list[Scene]]:
    """Scenes of the train split, and the product with all part types that stand in them."""
    others = round(settings.random_share * settings.scenes) if isinstance(settings, PairwiseSettings) else 0
    loose = round(settings.loose_share * settings.scenes) if isinstance(settings, PaperSettings) else 0
    catalogue = with_random_parts(product, seed, -(-others // SCENES_EACH))
    drawn = chain(
        draw_scenes(product, seed, settings.scenes - others - loose, "train", settings.data, settings.parts),
        draw_scenes(product, seed + _LOOSE_SEED, loose, "train", TRAY_SCENES, settings.parts),
        random_scenes(catalogue, len(product.parts), seed, others, settings),
    )
    console = Console(stderr=True, quiet=quiet)
    return catalogue, list(track(drawn, "drawing scenes", settings.scenes, console=console, transient=True))


def train_network(
    scenes: Sequence[Scene],
    product: Product,
    seed: int,
    settings: TrainingSettings,
    *,
    camera: TrayCamera | None = None,
) -> nn.Module:
    """A trained network that is not written; the same arguments give the same weights."""
    task = Task(seed=seed)
    recipe = grasp_recipe(scenes, product, settings, task, camera=camera)
    recipe.fit(task)
    return recipe.network


def grasp_recipe(
    scenes: Sequence[Scene],
    product: Product,
    settings: TrainingSettings,
    task: Task,
    *,
    camera: TrayCamera | None = None,
) -> Recipe:
    """An untrained network of the kind that the settings are of, but for what tells it footprints.

    Args:
        camera: takes the images of the scenes, where a network learns from them.
    """
    seed = task.seed
    torch.manual_seed(seed)
    begun = None if task.out is None else _footprints_of(task.out)
    seen = list(observed_again(scenes, seed, settings))
    fit = partial(fit_footprints, checkpoint=begun, quiet=task.quiet)
    network, data = _task(seen, product, settings, seed=seed, camera=camera, footprints=fit)

    def losses(epoch: int) -> Iterator[Tensor]:
        torch.manual_seed(seed * 100_003 + epoch)
        for chosen in torch.split(torch.randperm(len(data)), settings.batch):
            yield data.loss(network, chosen)

    return Recipe(
        kind="grasp.pairwise" if isinstance(settings, PairwiseSettings) else "grasp.paper",
        network=network,
        losses=losses,
        epochs=settings.epochs,
        batches=-(-len(data) // settings.batch),
        rate=settings.peak_rate,
        decay=settings.weight_decay,
        settings=settings,
        vocabulary=vocabulary_of(product),
        data_sha256=data_hash(scenes),
        gradient=1.0,
    )


def _footprints_of(out: Path) -> Path:
    """Where the unfinished fit of footprints is kept."""
    return out.with_name(f"{out.name}.checkpoint.footprints")


def vocabulary_of(product: Product) -> dict[str, tuple[str, ...]]:
    """Words of a network for a product."""
    return {"parts": tuple(product.parts), "words": words_of(tuple(product.parts))}


class TrainingData(Protocol):
    """Samples with their labels."""

    def __len__(self) -> int:
        """Their number."""
        ...

    def loss(self, net: Any, chosen: Tensor) -> Tensor:
        """Of samples chosen by their numbers (batch,)."""
        ...


def _task(
    scenes: list[Scene],
    product: Product,
    settings: TrainingSettings,
    *,
    seed: int,
    camera: TrayCamera | None,
    footprints: Callable[..., FootprintNet],
) -> tuple[nn.Module, TrainingData]:
    """An untrained network, but for what tells it footprints, and what it is to learn."""
    if isinstance(settings, PairwiseSettings):
        return PairNet(settings.hidden, settings.members), pair_data(scenes, product)
    assert isinstance(settings, PaperSettings)
    features = feature_count(product, settings.crops)
    types, sizes = len(product.parts), (settings.hidden, settings.layers)
    network = PaperNet(types, *sizes, features, settings.crops)
    maps = None
    if network.crops is not None:
        if camera is None:
            raise InputError("the paper's planner learns from images of the scenes: a camera is needed")
        crops = camera([(scene.boxes, scene.parts) for scene in scenes])
        seen = footprints(crops, scenes, list(product.parts), seed, settings.footprint_passes)
        network.crops.footprints = seen
        maps = [seen.maps(some) for some in crops]
    return network, graph_data(scenes, product, maps)


def _samples(settings: TrainingSettings, product: Product) -> list[dict[str, NDArray[Any]]]:
    """Random inputs on which the exported network must answer as the trained one does."""
    rng = np.random.default_rng(0)
    if isinstance(settings, PairwiseSettings):
        return [{"pairs": rng.normal(size=(rows, PAIR_FEATURES)).astype(np.float32)} for rows in (4, 1, 7)]
    assert isinstance(settings, PaperSettings)
    features = feature_count(product, settings.crops)
    return [
        {
            "nodes": rng.normal(size=(rows, MAX_PARTS, features)).astype(np.float32),
            "weights": rng.random((rows, MAX_PARTS, MAX_PARTS)).astype(np.float32) / MAX_PARTS,
            "present": np.ones((rows, MAX_PARTS), np.float32),
        }
        for rows in (3, 1, 5)
    ]


def split_by_run(scenes: Sequence[Scene], seed: int) -> tuple[list[Scene], list[Scene]]:
    """Scenes to learn from, and scenes to score on; all of one recorded run are on one side.

    Raises:
        InputError: there are too few scenes, or runs, to keep any for the scores.
    """
    names = [scene.run or f"scene {number}" for number, scene in enumerate(scenes)]
    runs = sorted(set(names), key=names.index)
    count = round(_TEST_SHARE * len(runs))
    if count == 0:
        what = f"{len(scenes)} scenes of {len(runs)} runs"
        raise InputError(f"{what} are too few to train on and to keep some for the scores; 3 runs are the fewest")
    order = np.random.default_rng([seed, len(runs)]).permutation(len(runs))
    kept = {runs[k] for k in order[:count]}
    pairs = list(zip(names, scenes, strict=True))
    return [some for name, some in pairs if name not in kept], [some for name, some in pairs if name in kept]
