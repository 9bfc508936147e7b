"""How wrong the tracker's three networks are, as training has it. Imports torch."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor
from torch.nn import functional as F

from bracket_lab.learned.hands.network import HEAT_PX, Finder, Reader, split_facts
from bracket_lab.learned.hands.refiner import Maps, Refiner
from bracket_lab.learned.training.training_loop import short_numbers

HEAT_SPREAD = 1.0  # cells, of the target of a heatmap
FOCAL_NEAR, FOCAL_EASY = 4, 2  # powers of the focal loss of CornerNet (Law 2018)
WEIGHTS = {
    "points": 10.0,
    "heat": 0.1,
    "box": 2.0,
    "heights": 0.2,
    "angle": 0.2,
    "present": 1.0,
    "side": 0.5,
    "acting": 0.5,
    "held": 1.0,
}
NOTHING_WEIGHT = 0.4  # of hands that hold nothing


def finder_loss(network: Finder, batch: Mapping[str, Tensor]) -> Tensor:
    """Focal loss of the scores, mean distance of the offsets, for each hand."""
    with short_numbers():
        seen = network.logits(batch["image"])
    logits, score, offset, weight = seen.float(), batch["score"], batch["offset"], batch["weight"]
    found = torch.sigmoid(logits[:, :1]).clamp(1e-4, 1 - 1e-4)
    hit = score == 1
    right = -((1 - found) ** FOCAL_EASY) * found.log()
    wrong = -((1 - score) ** FOCAL_NEAR) * found**FOCAL_EASY * (1 - found).log()
    away = (torch.sigmoid(logits[:, 1:]) - offset).abs().sum(dim=1, keepdim=True)
    total = (torch.where(hit, right + away, wrong) * weight).sum()
    return total / hit.sum().clamp(min=1)


def reader_loss(network: Reader, batch: Mapping[str, Tensor]) -> Tensor:
    """The weighted sum of all losses; only presence where there is no hand."""
    with short_numbers():  # points and sizes need more digits than what is seen
        seen = network.maps(batch["region"], batch["around"])
    deep, fine, heat, around = (one.float() for one in seen)
    points, facts = network.tell(deep, fine, heat, around, batch["place"])
    told = split_facts(facts)
    hand = batch["facts"][:, 0] > 0
    known = ((batch["points"] > 0) & (batch["points"] < 1)).all(dim=2) & hand[:, None]
    wanted = torch.nan_to_num(batch["points"])
    likely = F.binary_cross_entropy_with_logits(told.likely, torch.nan_to_num(batch["facts"]), reduction="none")
    typed = hand & batch["paint"] & (batch["held"] >= 0)
    sized, raised = hand & ~batch["angle"].isnan(), hand & ~batch["heights"].isnan().any(dim=1)
    sided = hand & ~batch["facts"][:, 1].isnan()
    batch = {**batch, **{name: torch.nan_to_num(batch[name]) for name in ("angle", "heights")}}
    held = batch["held"].clamp(min=0)
    terms = {
        "points": _mean((points - wanted).abs().sum(dim=2), known),
        "heat": _mean(-(heat_target(wanted) * F.log_softmax(heat.flatten(2), dim=2)).sum(dim=2), known),
        "box": _mean((told.box - batch["box"].clamp(-0.2, 1.2)).abs().mean(dim=1), hand),
        "heights": _mean(unlikely(told.heights_m - batch["heights"], told.height_errors_m).mean(dim=1), raised),
        "angle": _mean(unlikely(told.log_angle - batch["angle"], told.angle_error), sized),
        "present": likely[:, 0].mean(),
        "side": _mean(likely[:, 1], sided),
        "acting": _mean(likely[:, 2], hand),
        "held": _mean(F.cross_entropy(told.held, held, reduction="none") * _rarity(held), typed),
    }
    return torch.stack([WEIGHTS[name] * term for name, term in terms.items()]).sum()


def refiner_loss(network: Refiner, batch: Mapping[str, Tensor]) -> Tensor:
    """The weighted sum of the losses of points, heatmaps and size."""
    with short_numbers():  # points and sizes need more digits than what is seen
        seen = network.maps(batch["closeup"])
    maps = Maps(*(one.float() for one in seen))
    told = network.tell(maps, batch["place"])
    wanted = torch.nan_to_num(batch["points"])
    known = ((batch["points"] > 0) & (batch["points"] < 1)).all(dim=2)
    target = heat_target(wanted, maps.heat.shape[-1])
    terms = {
        "points": _mean((told.points - wanted).abs().sum(dim=2), known),
        "heat": _mean(-(target * F.log_softmax(maps.heat.flatten(2), dim=2)).sum(dim=2), known),
        "angle": unlikely(told.log_ratio - batch["ratio"], told.error).mean(),
    }
    return torch.stack([WEIGHTS[name] * term for name, term in terms.items()]).sum()


def heat_target(points: Tensor, side: int = HEAT_PX) -> Tensor:
    """Normal distributions about points (n, k, 2), as (n, k, cells) that sum to 1."""
    middles = torch.arange(side, device=points.device) + 0.5
    away = ((points[..., None] * side - middles) / HEAT_SPREAD).pow(2)  # (n, k, 2, s)
    logits = -(away[:, :, 1, :, None] + away[:, :, 0, None, :]) / 2
    return torch.softmax(logits.flatten(2), dim=2)


def unlikely(wrong: Tensor, error: Tensor) -> Tensor:
    """Minus the logarithm of the probability of being so wrong (Laplace), where the mean error is told."""
    return wrong.abs() / error + error.log()


def _rarity(held: Tensor) -> Tensor:
    """(n,) Weights: most hands hold nothing."""
    return torch.where(held == 0, NOTHING_WEIGHT, 1.0)


def _mean(values: Tensor, chosen: Tensor) -> Tensor:
    return (values * chosen).sum() / chosen.sum().clamp(min=1)
