"""Views of several pictures side by side, padded, with what is right for them. Imports torch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from bracket_ground.interfaces.pose import Array
from bracket_lab.experiments.stacks.checks import children_first
from bracket_lab.experiments.stacks.views import Labelled, StackView
from bracket_lab.learned.grasp.graph import edge_weights

GEOMETRY = 10  # of a pair
FATHER, CHILD, NOTHING = range(3)  # of a pair (i, j): i lies below j, on it, or neither
MOST_ON_TOP = 7  # words of the longest answer


@dataclass(frozen=True)
class Batch:
    """Views, b of them with n objects at most.

    Attributes:
        labels: (b, n, classes) one-hot.
        boxes: (b, n, 4) as shares of the picture.
        regions, unions: (b, n, f) and (b, n, n, f).
        pairs: (b, n, n, GEOMETRY) how box j lies to box i.
        weights: (b, n, n) e_ij of Eq. 4, of the boxes' middles.
        present: (b, n) 1 where there is an object.
    """

    labels: Tensor
    boxes: Tensor
    regions: Tensor
    unions: Tensor
    pairs: Tensor
    weights: Tensor
    present: Tensor


@dataclass(frozen=True)
class Answers:
    """What is right for a batch.

    Attributes:
        relations: (b, n, n) FATHER, CHILD or NOTHING of each ordered pair.
        above: (b, n, n), [i, j] 1 where j lies on i, also by way of others.
        order: (b, n, MOST_ON_TOP) what is to be taken before i, in order; -1 behind the last.
    """

    relations: Tensor
    above: Tensor
    order: Tensor

    @property
    def graspable(self) -> Tensor:
        """(b, n)."""
        return (self.above.sum(-1) == 0).float()


def batch_of(views: Sequence[StackView], classes: Sequence[str]) -> Batch:
    """Views side by side."""
    size, most = len(views), max(1, *(len(view.names) for view in views))
    wide = max(view.regions.shape[1] for view in views)
    labels, boxes = np.zeros((size, most, len(classes)), np.float32), np.zeros((size, most, 4), np.float32)
    regions, unions = np.zeros((size, most, wide), np.float32), np.zeros((size, most, most, wide), np.float32)
    pairs = np.zeros((size, most, most, GEOMETRY), np.float32)
    weights, present = np.zeros((size, most, most), np.float32), np.zeros((size, most), np.float32)
    for k, view in enumerate(views):
        count = len(view.names)
        if not count:
            continue
        labels[k, np.arange(count), [classes.index(name) for name in view.names]] = 1.0
        boxes[k, :count], regions[k, :count], present[k, :count] = view.boxes, view.regions, 1.0
        unions[k, :count, :count], pairs[k, :count, :count] = view.unions, pair_geometry(view.boxes)
        middles = (view.boxes[:, :2] + view.boxes[:, 2:]) / 2
        weights[k, :count, :count] = edge_weights(middles)
    return Batch(*(torch.from_numpy(values) for values in (labels, boxes, regions, unions, pairs, weights, present)))


def pair_geometry(boxes: Array) -> Array:
    """(n, n, GEOMETRY) of boxes (n, 4): where j lies from i, how large it is, and how much they overlap."""
    low, high = boxes[:, :2], boxes[:, 2:]
    middle, size = (low + high) / 2, np.maximum(high - low, 1e-4)
    scale = np.sqrt(size.prod(axis=1))
    between = (middle[None] - middle[:, None]) / scale[:, None, None]
    grown = np.log(size[None] / size[:, None])
    met = np.maximum(np.minimum(high[:, None], high) - np.maximum(low[:, None], low), 0).prod(axis=-1)
    area = size.prod(axis=1)
    shares = np.stack([met / area[:, None], met / area[None], met / (area[:, None] + area[None] - met)], axis=-1)
    reach = np.maximum(high[:, None], high) - np.minimum(low[:, None], low)
    larger = np.log(scale[:, None, None] / scale[None, :, None])
    geometry: Array = np.concatenate([between, grown, shares, reach, larger], axis=-1)
    return geometry


def overlaps(boxes: Array, least: float = 0.05) -> Array:
    """(n, n) whether two boxes share this much of the smaller one."""
    shares = pair_geometry(boxes)[..., 4:6].max(axis=-1)
    met: Array = shares > least
    np.fill_diagonal(met, False)
    return met


def answers_of(examples: Sequence[Labelled]) -> Answers:
    """What is right for some views of true boxes."""
    size, most = len(examples), max(len(example.view.names) for example in examples)
    relations = np.full((size, most, most), NOTHING)
    above, order = np.zeros((size, most, most), np.float32), np.full((size, most, MOST_ON_TOP), -1)
    for k, example in enumerate(examples):
        count, place = len(example.view.names), {each.index: row for row, each in enumerate(example.scene.objects)}
        relations[k, :count, :count] = np.where(example.children, FATHER, np.where(example.children.T, CHILD, NOTHING))
        above[k, :count, :count] = example.above
        for row, each in enumerate(example.scene.objects):
            taken = [place[index] for index in children_first(example.scene, each.index)][:MOST_ON_TOP]
            order[k, row, : len(taken)] = taken
    return Answers(*(torch.from_numpy(values) for values in (relations, above, order)))
