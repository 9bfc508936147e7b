"""Training of the grasp planners on drawn or recorded scenes, in minutes on a CPU, and export to ONNX."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
import torch
from rich.console import Console
from rich.progress import track
from torch import Tensor, nn

from cell.interfaces.errors import InputError
from cell.interfaces.product import Product
from learned.grasp.evaluate import evaluate_grasp, evaluate_scenes
from learned.grasp.fitting import fit
from learned.grasp.graph import MAX_PARTS, feature_count
from learned.grasp.language import WORDS
from learned.grasp.observing import observed_again
from learned.grasp.pairs import PAIR_FEATURES
from learned.grasp.pairwise import PairNet, pair_data
from learned.grasp.paper import PaperNet, graph_data
from learned.grasp.planner import load_grasp_planner
from learned.grasp.relations import RelationNet, relation_data, relation_features
from learned.grasp.scenes import Scene, data_hash, draw_scenes
from learned.grasp.training_settings import PairwiseSettings, PaperSettings, RelationSettings, TrainingSettings
from learned.onnx_model import ModelCard, save_onnx

TRAINED_KINDS = ("pairwise", "paper")
_TEST_SHARE = 0.2  # of given scenes, kept for the scores
_OPSET = 20


def train_grasp(
    product: Product,
    out: Path,
    seed: int,
    kind: str,
    *,
    settings: TrainingSettings | None = None,
    scenes: Sequence[Scene] | None = None,
    checkpoints: Path | None = None,
    quiet: bool = False,
    command: str = "",
) -> dict[str, float]:
    """Train, write the weights with their model card, and score the written file on scenes that were kept apart.

    Args:
        out: the ONNX file.
        kind: "pairwise" or "paper".
        settings: of that kind; its defaults where None.
        scenes: to learn from, one in five of them kept for the scores; drawn ones where None.
        checkpoints: folder in which an interrupted training is kept to go on from.
        quiet: no progress bar.
        command: what was typed, for the model card.

    Returns:
        Scores by name, the same as on the model card.

    Raises:
        InputError: `kind` is not one that can be trained, or too few scenes are given.
    """
    if kind not in TRAINED_KINDS:
        raise InputError(f"no grasp planner {kind!r} can be trained; legal: {', '.join(TRAINED_KINDS)}")
    console = Console(stderr=True, quiet=quiet)
    settings = settings or (PairwiseSettings() if kind == "pairwise" else PaperSettings())
    test: list[Scene] = []
    if scenes is None:
        learned = training_scenes(product, seed, settings, console)
        split = f"{len(learned)} scenes of the train split; scores on {settings.test_scenes} of the test split"
    else:
        learned, test = _split(scenes, seed)
        split = f"{len(learned)} given scenes; scores on {len(test)} others of them"
    checkpoint = _checkpoint(checkpoints, kind, learned, settings, seed)
    model = _trained_model(kind, learned, product, seed, settings, console, checkpoint)
    card = ModelCard(
        kind=f"grasp.{kind}",
        config=settings.model_dump(mode="json") | {"split": split},
        vocabulary={"parts": tuple(product.parts), "words": WORDS},
        data_sha256=data_hash(learned),
        command=command or f"train_grasp(kind={kind!r}, seed={seed})",
        seed=seed,
    )
    save_onnx(model, out, card)
    planner = load_grasp_planner(kind, out, product)
    if test:
        scores = evaluate_scenes(planner, test, seed)
    else:
        scores = evaluate_grasp(planner, product, seed, settings.test_scenes, settings.data)
    save_onnx(model, out, card.model_copy(update={"scores": scores}))
    if checkpoint is not None:
        checkpoint.unlink(missing_ok=True)
    return scores


def training_scenes(product: Product, seed: int, settings: TrainingSettings, console: Console) -> list[Scene]:
    """Scenes of the train split."""
    drawn = draw_scenes(product, seed, settings.scenes, "train", settings.data, settings.parts)
    return list(track(drawn, "drawing scenes", settings.scenes, console=console, transient=True))


def train_pairwise(
    scenes: Sequence[Scene],
    product: Product,
    seed: int,
    settings: PairwiseSettings,
    console: Console,
    checkpoint: Path | None = None,
) -> PairNet:
    """A trained pairwise network; the same arguments give the same weights."""
    torch.manual_seed(seed)
    data = pair_data(list(observed_again(scenes, seed, settings)), product)
    net = new_pairwise(settings)
    fit(net, len(data), lambda chosen: data.loss(net, chosen), settings, seed, console, checkpoint)
    return net.eval()


def train_paper(
    scenes: Sequence[Scene],
    product: Product,
    seed: int,
    settings: PaperSettings,
    console: Console,
    checkpoint: Path | None = None,
) -> PaperNet:
    """A trained network of the paper; the same arguments give the same weights."""
    torch.manual_seed(seed)
    seen = list(observed_again(scenes, seed, settings))
    data = graph_data(seen, product, settings.edges, settings.filter_m, settings.data.crops)
    net = new_paper(product, settings)
    fit(net, len(data), lambda chosen: data.loss(net, chosen), settings, seed, console, checkpoint)
    return net.eval()


def train_relations(
    scenes: Sequence[Scene], product: Product, seed: int, settings: RelationSettings, console: Console
) -> RelationNet:
    """A trained network of GVMRN-RF; the same arguments give the same weights."""
    torch.manual_seed(seed)
    data = relation_data(list(observed_again(scenes, seed, settings)), product)
    net = new_relations(product, settings)
    fit(net, len(data), lambda chosen: data.loss(net, chosen), settings, seed, console)
    return net.eval()


def new_pairwise(settings: PairwiseSettings) -> PairNet:
    """An untrained network."""
    return PairNet(settings.hidden, settings.members)


def new_paper(product: Product, settings: PaperSettings) -> PaperNet:
    """An untrained network."""
    features = feature_count(product, settings.data.crops)
    return PaperNet(features, settings.hidden, settings.layers, settings.edges != "gcn", settings.attention)


def new_relations(product: Product, settings: RelationSettings) -> RelationNet:
    """An untrained network."""
    return RelationNet(relation_features(product), settings.hidden)


def export_pairwise(net: PairNet) -> onnx.ModelProto:
    """ONNX: `pairs` (p, PAIR_FEATURES) to `logits` (p,)."""
    return _export(net, {"pairs": torch.zeros(4, PAIR_FEATURES)}, ["logits"])


def export_paper(net: PaperNet) -> onnx.ModelProto:
    """ONNX: padded scene graphs to `verdict` (b,), logits, and `words` (b, MAX_WORDS)."""
    graphs = {
        "nodes": torch.zeros(3, MAX_PARTS, net.features),
        "weights": torch.zeros(3, MAX_PARTS, MAX_PARTS),
        "present": torch.ones(3, MAX_PARTS),
    }
    return _export(net, graphs, ["verdict", "words"])


def _trained_model(
    kind: str,
    scenes: Sequence[Scene],
    product: Product,
    seed: int,
    settings: TrainingSettings,
    console: Console,
    checkpoint: Path | None,
) -> onnx.ModelProto:
    if isinstance(settings, PairwiseSettings):
        return export_pairwise(train_pairwise(scenes, product, seed, settings, console, checkpoint))
    if isinstance(settings, PaperSettings):
        return export_paper(train_paper(scenes, product, seed, settings, console, checkpoint))
    raise InputError(f"{type(settings).__name__} are no settings of the planner {kind!r}")


def _split(scenes: Sequence[Scene], seed: int) -> tuple[list[Scene], list[Scene]]:
    """Scenes to learn from, and scenes to score on."""
    count = round(_TEST_SHARE * len(scenes))
    if count == 0:
        raise InputError(f"{len(scenes)} scenes are too few to train on and to keep some for the scores")
    order = np.random.default_rng([seed, len(scenes)]).permutation(len(scenes))
    return [scenes[k] for k in order[count:]], [scenes[k] for k in order[:count]]


def _checkpoint(
    folder: Path | None, kind: str, scenes: Sequence[Scene], settings: TrainingSettings, seed: int
) -> Path | None:
    """A file of its own for each data set, settings and seed."""
    if folder is None:
        return None
    identity = f"{data_hash(scenes)} {settings.model_dump_json()} {seed}"
    return folder / f"grasp_{kind}_{hashlib.sha256(identity.encode()).hexdigest()[:16]}.pt"


def _export(
    net: nn.Module,
    inputs: dict[str, Tensor],
    outputs: list[str],
) -> onnx.ModelProto:
    """A network whose inputs and outputs have any number of rows."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exporter warns about its own internals
        program = torch.onnx.export(
            net,
            tuple(inputs.values()),
            input_names=list(inputs),
            output_names=outputs,
            dynamic_shapes={name: {0: torch.export.Dim.DYNAMIC} for name in inputs},
            dynamo=True,
            opset_version=_OPSET,
            verbose=False,
        )
    assert program is not None  # only the exporter without dynamo returns None
    return program.model_proto
