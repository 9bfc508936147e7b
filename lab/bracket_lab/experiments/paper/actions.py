"""The paper's Fig. 10: detectors of actions against baselines, over splits of the same recordings. Imports torch."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.actions.segments import SegmentReader
from bracket_cell.learned.actions.settings import WHOLE_FRAMES, ActionTraining
from bracket_lab.learned.actions.data import Segments
from bracket_lab.learned.actions.evaluate import answers
from bracket_lab.learned.actions.train import OUTPUTS, Task, action_recipe
from bracket_lab.learned.scores import student
from bracket_lab.learned.training.recipe import Task as Training
from bracket_lab.learned.training.torch_model import TorchModel

KINDS = ("slim", "paper", "cnn_lstm", "hand", "lrcn")
NAMES = {
    "slim": "slim",
    "paper": "LSTM-FCN + VGG16 (`paper`)",
    "cnn_lstm": "VGG16 + plain LSTM",
    "hand": "hand-centric CNN",
    "lrcn": "LRCN",
}
CONTROLS: Mapping[str, Mapping[str, Any]] = {
    "": {},
    "black crops": {"blank": True},
    "shuffled track": {"shuffle_seed": 0},
}
COMMONEST = "commonest class"
FOLDS = 5
MEASURES = ("all", "outside_guard", "assemblies")
Row = dict[str, object]


def measure_folds(
    task: Task,
    segments: Segments,
    wanted: Iterable[tuple[int, str]],
    settings: ActionTraining,
    folds: int = FOLDS,
    seed: int = 0,
) -> Iterator[Row]:
    """A row for each split and kind: how many segments of the recordings that were kept apart are named right.

    Args:
        wanted: (split, kind).
    """
    reader = SegmentReader(task.bench, task.product)
    for fold, kind in wanted:
        learned, kept = segments.without(fold, folds)
        began_s = time.process_time()
        recipe, asked = action_recipe(task, learned, kind, settings, seed=seed + fold), Training(seed=seed + fold)
        recipe.fit(asked)
        spent_s = time.process_time() - began_s
        model = TorchModel(recipe.network, OUTPUTS, recipe.card(asked))
        row: Row = {"fold": fold, "kind": kind, "processor_s": round(spent_s, 1), "learned": len(learned)}
        for control, changed in CONTROLS.items():
            if kind in WHOLE_FRAMES and "blank" in changed:
                continue  # without its frames nothing is left to look at
            posterior, _ = answers(model, kept, reader, noise_seed=fold, **changed)
            row[control or "told"] = _counts(kept, posterior.argmax(axis=1), task.classes.assemblies)
        yield row | {COMMONEST: commonest(learned, kept, task.classes.assemblies)}


def _measured(segments: Segments, assemblies: int) -> dict[str, NDArray[np.bool_]]:
    """Which segments count, by measure."""
    clear = ~segments.guarded
    everything = np.ones(len(clear), bool)
    return {"all": everything, "outside_guard": clear, "assemblies": clear & (segments.classes < assemblies)}


def _counts(segments: Segments, named: Any, assemblies: int) -> dict[str, list[int]]:
    """(right, of) by measure."""
    right = named == segments.classes
    return {name: [int(right[rows].sum()), int(rows.sum())] for name, rows in _measured(segments, assemblies).items()}


def commonest(learned: Segments, kept: Segments, assemblies: int) -> dict[str, list[int]]:
    """(right, of) by measure, of who always names the commonest class of those that were learned from."""
    of_learned, of_kept = (_measured(segments, assemblies) for segments in (learned, kept))
    answers_by = {name: np.bincount(learned.classes[rows]).argmax() for name, rows in of_learned.items()}
    return {
        name: [int((kept.classes[of_kept[name]] == answer).sum()), int(of_kept[name].sum())]
        for name, answer in answers_by.items()
    }


def summary(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """For each kind and control: mean over the splits of the shares that were right, and half of its 95 % interval.

    The last control is who always names the commonest class.
    """
    found = []
    for kind in KINDS:
        of_kind = [row for row in rows if row["kind"] == kind]
        for control in (*CONTROLS, COMMONEST):
            counts = [row[control or "told"] for row in of_kind if (control or "told") in row]
            if not counts:
                continue
            line: dict[str, Any] = {"kind": kind, "control": control, "splits": len(counts)}
            for name in MEASURES:
                mean, half = student([row[name][0] / max(1, row[name][1]) for row in counts])
                line[name] = [round(mean, 4), round(half, 4)]
            found.append(line)
    return found


def shares(rows: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, dict[str, Any]]]:
    """Means over the splits with their intervals, by kind and measure, and the trivial ones; without the controls."""
    found = summary(rows)
    trivial = {(row["kind"], name): row[name][0] for row in found if row["control"] == COMMONEST for name in MEASURES}
    return {
        row["kind"]: {
            name: {
                "share": mean,
                "low": max(0.0, mean - half),
                "high": min(1.0, mean + half),
                "n": f"{row['splits']} splits",
                "trivial": trivial.get((row["kind"], name)),
            }
            for name in MEASURES
            for mean, half in [row[name]]
        }
        for row in found
        if not row["control"]
    }


def page(rows: Sequence[Mapping[str, Any]]) -> str:
    """The table in Markdown."""
    lines = [
        "| network | control | splits | all segments | outside the guard band | assemblies |",
        "|---|---|---|---|---|---|",
    ]
    for row in summary(rows):
        shares = (f"{row[name][0]:.3f} +- {row[name][1]:.3f}" for name in MEASURES)
        lines.append(f"| {NAMES[row['kind']]} | {row['control']} | {row['splits']} | {' | '.join(shares)} |")
    return "\n".join(lines)
