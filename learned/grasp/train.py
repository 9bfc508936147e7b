"""Training of the grasp planners on drawn scenes, in minutes on a CPU, and export to ONNX (decision 5)."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from pathlib import Path

import onnx
import torch
from rich.console import Console
from rich.progress import track
from torch import Tensor, nn

from cell.interfaces.errors import InputError
from cell.interfaces.product import Product
from learned.grasp.evaluate import evaluate_grasp
from learned.grasp.graph import MAX_PARTS, feature_count
from learned.grasp.language import WORDS
from learned.grasp.pairs import PAIR_FEATURES
from learned.grasp.pairwise import PairNet, pair_data
from learned.grasp.paper import PaperNet, graph_data
from learned.grasp.planner import load_grasp_planner
from learned.grasp.scenes import Scene, data_hash, draw_scenes
from learned.grasp.training_settings import PairwiseSettings, PaperSettings, TrainingSettings
from learned.onnx_model import ModelCard, save_onnx

TRAINED_KINDS = ("pairwise", "paper")
_OPSET = 20


def train_grasp(
    product: Product,
    out: Path,
    seed: int,
    kind: str,
    *,
    settings: TrainingSettings | None = None,
    quiet: bool = False,
    command: str = "",
) -> dict[str, float]:
    """Draw scenes, train, write the weights with their model card, and score the written file on test scenes.

    Args:
        out: the ONNX file.
        kind: "pairwise" or "paper".
        settings: of that kind; its defaults where None.
        quiet: no progress bar.
        command: what was typed, for the model card.

    Returns:
        Scores by name, the same as on the model card.

    Raises:
        InputError: `kind` is not one that can be trained.
    """
    console = Console(stderr=True, quiet=quiet)
    if kind == "pairwise":
        pairwise = settings if isinstance(settings, PairwiseSettings) else PairwiseSettings()
        scenes = _scenes(product, seed, pairwise, console)
        model = export_pairwise(train_pairwise(scenes, product, seed, pairwise, console))
        settings = pairwise
    elif kind == "paper":
        paper = settings if isinstance(settings, PaperSettings) else PaperSettings()
        scenes = _scenes(product, seed, paper, console)
        model = export_paper(train_paper(scenes, product, seed, paper, console))
        settings = paper
    else:
        raise InputError(f"no grasp planner {kind!r} can be trained; legal: {', '.join(TRAINED_KINDS)}")
    card = ModelCard(
        kind=f"grasp.{kind}",
        config=settings.model_dump(mode="json"),
        vocabulary={"parts": tuple(product.parts), "words": WORDS},
        data_sha256=data_hash(scenes),
        command=command or f"train_grasp(kind={kind!r}, seed={seed})",
        seed=seed,
    )
    save_onnx(model, out, card)
    scores = evaluate_grasp(load_grasp_planner(kind, out, product), product, seed, settings.test_scenes, settings.data)
    save_onnx(model, out, card.model_copy(update={"scores": scores}))
    return scores


def train_pairwise(
    scenes: list[Scene], product: Product, seed: int, settings: PairwiseSettings, console: Console
) -> PairNet:
    """A trained pairwise network; the same arguments give the same weights."""
    torch.manual_seed(seed)
    data = pair_data(scenes, product)
    net = PairNet(settings.hidden, settings.members)
    _fit(net, len(data), lambda chosen: data.loss(net, chosen), settings, console)
    return net.eval()


def train_paper(
    scenes: list[Scene], product: Product, seed: int, settings: PaperSettings, console: Console
) -> PaperNet:
    """A trained network of the paper; the same arguments give the same weights."""
    torch.manual_seed(seed)
    data = graph_data(scenes, product, settings.edges)
    net = PaperNet(feature_count(product), settings.hidden, settings.layers)
    _fit(net, len(data), lambda chosen: data.loss(net, chosen), settings, console)
    return net.eval()


def export_pairwise(net: PairNet) -> onnx.ModelProto:
    """ONNX: `pairs` (p, PAIR_FEATURES) to `logits` (p,)."""
    pairs = torch.export.Dim("pairs", min=1)
    return _export(net, {"pairs": torch.zeros(4, PAIR_FEATURES)}, ["logits"], {"pairs": {0: pairs}})


def export_paper(net: PaperNet) -> onnx.ModelProto:
    """ONNX: one padded scene graph to `verdict` (1,), a logit, and `words` (1, MAX_WORDS)."""
    graph = {
        "nodes": torch.zeros(1, MAX_PARTS, net.features),
        "weights": torch.zeros(1, MAX_PARTS, MAX_PARTS),
        "present": torch.ones(1, MAX_PARTS),
    }
    return _export(net, graph, ["verdict", "words"], None)


def _export(
    net: nn.Module,
    inputs: dict[str, Tensor],
    outputs: list[str],
    dynamic: dict[str, dict[int, torch.export.Dim]] | None,
) -> onnx.ModelProto:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exporter warns about its own internals
        program = torch.onnx.export(
            net,
            tuple(inputs.values()),
            input_names=list(inputs),
            output_names=outputs,
            dynamic_shapes=dynamic,
            dynamo=True,
            opset_version=_OPSET,
            verbose=False,
        )
    assert program is not None  # only the exporter without dynamo returns None
    return program.model_proto


def _scenes(product: Product, seed: int, settings: TrainingSettings, console: Console) -> list[Scene]:
    drawn = draw_scenes(product, seed, settings.scenes, "train", settings.data, settings.parts)
    return list(track(drawn, "drawing scenes", settings.scenes, console=console, transient=True))


def _fit(
    net: nn.Module, count: int, loss: Callable[[Tensor], Tensor], settings: TrainingSettings, console: Console
) -> None:
    steps = -(-count // settings.batch)
    optimiser = torch.optim.AdamW(net.parameters(), settings.peak_rate, weight_decay=settings.weight_decay)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, settings.peak_rate, total_steps=settings.epochs * steps)
    for _ in track(range(settings.epochs), "training", console=console, transient=True):
        for chosen in torch.split(torch.randperm(count), settings.batch):
            optimiser.zero_grad()
            torch.autograd.backward(loss(chosen))
            nn.utils.clip_grad_norm_(net.parameters(), 1.0)
            optimiser.step()
            schedule.step()
