"""How often a network names the right class, for which classes, and what it takes for what."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.actions.events import Floats
from bracket_cell.learned.actions.segments import SegmentReader, known_features, posterior_of
from bracket_cell.learned.actions.settings import Classes
from bracket_cell.learned.inference.onnx_model import Network
from bracket_lab.learned.actions.data import Segments, asked
from bracket_lab.learned.actions.variation import Variation

BATCH = 64
TIMED = 200  # answers whose time is taken
TIME_AXIS = {"track": 2, "frames": 1}
# What a tracker adds to segments that are not trained on.
TRACKER = Variation(worse=0.0, shift_px=1.5, gain=0.0, blank=0.0, flat=0.0, retaken=0.0, covered=0.0)


def answers(
    network: Network,
    segments: Segments,
    reader: SegmentReader,
    *,
    blank: bool = False,
    shuffle_seed: int | None = None,
    noise_seed: int | None = None,
) -> tuple[Floats, Floats]:
    """Posterior (n, classes), and the probability (n,) that the fingers have opened.

    Args:
        noise_seed: tracks as a tracker would tell them, whose noise this seed draws; as they are where it is None.
        blank: black crops instead of the segments' own, as a control.
        shuffle_seed: tracks with their frames in another order, as a control.
    """
    posteriors, released = [], []
    rng = None if shuffle_seed is None else np.random.default_rng(shuffle_seed)
    noise = None if noise_seed is None else np.random.default_rng(noise_seed)
    for begin in range(0, len(segments), BATCH):
        chosen = np.arange(begin, min(begin + BATCH, len(segments)))
        inputs = asked(network.card.kind.removeprefix("actions."), segments, chosen, reader, noise, TRACKER)
        if "track" in inputs:
            inputs["track"] = known_features(network.card, inputs["track"])
        if rng is not None:
            inputs |= {name: _shuffled(values, name, rng) for name, values in inputs.items() if name in TIME_AXIS}
        if blank:
            inputs |= {name: np.zeros_like(values) for name, values in inputs.items() if name != "track"}
        found = network.run(inputs)
        posteriors.append(posterior_of(found["logits"]))
        released.append(1.0 / (1.0 + np.exp(-found["released"].astype(float))))
    return np.concatenate(posteriors), np.concatenate(released)


def times_s(network: Network, segments: Segments, reader: SegmentReader) -> list[float]:
    """Processor time of answers to single segments."""
    found = []
    for number in range(min(TIMED, len(segments))):
        began_s = time.process_time()
        inputs = asked(network.card.kind.removeprefix("actions."), segments, np.array([number]), reader)
        if "track" in inputs:
            inputs["track"] = known_features(network.card, inputs["track"])
        network.run(inputs)
        found.append(time.process_time() - began_s)
    return found


def _shuffled(values: NDArray[Any], name: str, rng: np.random.Generator) -> NDArray[Any]:
    """Each segment's frames in another order."""
    axis = TIME_AXIS[name]
    return np.stack([rng.permutation(value, axis=axis - 1) for value in values])


def class_scores(segments: Segments, posterior: Floats, classes: Classes) -> dict[str, float]:
    """Shares of segments that were named right: all, outside the guard band, and of assemblies part and position."""
    right = posterior.argmax(axis=1) == segments.classes
    clear = ~segments.guarded
    placing = (segments.classes < classes.assemblies) & clear
    pairs = posterior[:, : classes.assemblies].argmax(axis=1)
    part, position = np.divmod(pairs, len(classes.positions))
    true_part, true_position = np.divmod(segments.classes, len(classes.positions))
    found = {
        "accuracy": right,
        "accuracy_outside_guard": right[clear],
        "assembly_accuracy": right[placing],
        "assembly_part": (part == true_part)[placing],
        "assembly_position": (position == true_position)[placing],
    }
    for index, name in enumerate(("screw", "transit", "idle")):
        found[f"{name}_accuracy"] = right[(segments.classes == classes.assemblies + index) & clear]
    return {name: round(float(values.mean()), 4) for name, values in found.items() if len(values)}


def confusion(segments: Segments, posterior: Floats, classes: Classes) -> NDArray[np.int64]:
    """(classes, classes) counts outside the guard band: rows as it was, columns as it was named."""
    found = np.zeros((len(classes.names),) * 2, np.int64)
    clear = ~segments.guarded
    np.add.at(found, (segments.classes[clear], posterior.argmax(axis=1)[clear]), 1)
    return found
