"""Does the way of the hand alone give the part away? `python -m tests.benchmarks.track_probe --person varied`

A small network sees nothing but fingertips and palm from above in the last 45 frames before the end of a segment in
which a part is assembled, and names the type of the part and the hole. What the hole and the quantities of the goals
alone tell of the type is the floor; more than 0.06 above it is a leak.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from bracket_cell.configuration import load_configuration, load_product
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.perception import SEGMENT_FRAMES
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product
from bracket_lab.drawing.without_physics import KinematicBench, Recording
from bracket_sim.scene.person import load_person
from bracket_sim.truth.labels import guarded, labels

TEST_SEED = 900_000  # seeds of training, validation and test never meet
VALIDATION_SEED = 800_000
TRACK_NOISE_M = 0.002
CLIPS_A_RELEASE = 3
SCALE_M = 0.2


@dataclass(frozen=True)
class Clips:
    """n assembly clips.

    Attributes:
        tracks: (n, 4, SEGMENT_FRAMES) fingertips and palm (x, y) from the bracket, in units of SCALE_M.
        parts, holes: (n,) classes.
    """

    tracks: NDArray[np.float32]
    parts: NDArray[np.int64]
    holes: NDArray[np.int64]


class Probe(nn.Module):
    """Three convolutions and an LSTM beside each other, as in LSTM-FCN; two answers."""

    def __init__(self, parts: int, holes: int) -> None:
        super().__init__()
        self.convolutions = nn.Sequential(
            *(layer for channels in ((4, 48), (48, 64), (64, 64)) for layer in _block(*channels))
        )
        self.recurrent = nn.LSTM(4, 48, batch_first=True)
        width = 64 * SEGMENT_FRAMES // 5 + 48
        self.part = nn.Sequential(nn.Linear(width, 96), nn.ReLU(), nn.Dropout(0.2), nn.Linear(96, parts))
        self.hole = nn.Linear(width, holes)

    def forward(self, tracks: Tensor) -> tuple[Tensor, Tensor]:
        """(n, parts) and (n, holes) logits of (n, 4, frames) tracks."""
        pooled = nn.functional.avg_pool1d(self.convolutions(tracks), 5).flatten(1)
        _, (last, _) = self.recurrent(tracks.transpose(1, 2))
        features = torch.cat([pooled, last[-1]], dim=1)
        return self.part(features), self.hole(features)


def _block(before: int, after: int) -> tuple[nn.Module, ...]:
    return nn.Conv1d(before, after, 5, padding=2), nn.BatchNorm1d(after), nn.ReLU()


def clips(product: Product, bench: Bench, person: str, recordings: int, first_seed: int) -> Clips:
    """Record and cut."""
    world = KinematicBench(product, bench, load_person(person))
    goals = sorted(product.goals)
    found: list[tuple[NDArray[np.float32], int, int]] = []
    for seed in range(first_seed, first_seed + recordings):
        rng = np.random.default_rng([seed, 1])
        recording = world.record(goals[int(rng.integers(len(goals)))], seed)
        found += _cut(recording, product, bench, rng)
    tracks, parts, holes = zip(*found, strict=True)
    return Clips(np.stack(tracks), np.array(parts), np.array(holes))


def _cut(
    recording: Recording, product: Product, bench: Bench, rng: np.random.Generator
) -> list[tuple[NDArray[np.float32], int, int]]:
    """A few clips of each assembly, outside the guard band."""
    track = np.concatenate([recording.fingertips_m[:, :2], recording.palm_m[:, :2]], axis=1)
    track = track + rng.normal(0.0, TRACK_NOISE_M, track.shape) - np.tile(bench.bracket.position_m[:2], 2)
    found = labels(recording.actions, recording.acts, recording.times_s)
    usable = ~guarded(found, recording.times_s)
    parts, holes = list(product.parts), list(product.positions)
    runs: list[list[int]] = []
    for index, label in enumerate(found):
        if label.kind == "assembly" and usable[index] and index >= SEGMENT_FRAMES:
            if not runs or runs[-1][-1] != index - 1:
                runs.append([])
            runs[-1].append(index)
    cut = []
    for run in runs:
        for index in rng.choice(run, min(CLIPS_A_RELEASE, len(run)), replace=False):
            label = found[index]
            assert label.part is not None
            assert label.position is not None
            window: Array = track[index - SEGMENT_FRAMES + 1 : index + 1].T / SCALE_M
            cut.append((window.astype(np.float32), parts.index(label.part), holes.index(label.position)))
    return cut


def train(data: Clips, validation: Clips, parts: int, holes: int, epochs: int) -> Probe:
    """Fit; the epoch that names the most parts of the validation clips counts."""
    torch.manual_seed(0)
    probe = Probe(parts, holes)
    optimiser = torch.optim.AdamW(probe.parameters(), lr=2e-3, weight_decay=1e-3)
    steps = epochs * -(-len(data.parts) // 128)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, 4e-3, total_steps=steps)
    tracks, kinds, places = (torch.from_numpy(values) for values in (data.tracks, data.parts, data.holes))
    best, kept = -1.0, probe.state_dict()
    for _ in range(epochs):
        probe.train()
        for batch in torch.randperm(len(kinds)).split(128):  # type: ignore[no-untyped-call]
            part, hole = probe(tracks[batch])
            loss = nn.functional.cross_entropy(part, kinds[batch]) + nn.functional.cross_entropy(hole, places[batch])
            optimiser.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimiser.step()
            schedule.step()
        share = accuracy(probe, validation)[0]
        if share > best:
            best, kept = share, {name: value.clone() for name, value in probe.state_dict().items()}
    probe.load_state_dict(kept)
    return probe


def accuracy(probe: Probe, data: Clips) -> tuple[float, float]:
    """Shares of parts and of holes named rightly."""
    probe.eval()
    with torch.no_grad():
        part, hole = probe(torch.from_numpy(data.tracks))
    return (
        float((part.argmax(1).numpy() == data.parts).mean()),
        float((hole.argmax(1).numpy() == data.holes).mean()),
    )


def floor(data: Clips, test: Clips, parts: int, holes: int) -> float:
    """Share of parts that the hole alone names: the type most frequent there in training."""
    counts = np.zeros((holes, parts))
    np.add.at(counts, (data.holes, data.parts), 1)
    return float((counts.argmax(1)[test.holes] == test.parts).mean())


def main() -> None:
    """Print one line of JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--person", default="varied")
    parser.add_argument("--recordings", type=int, default=600)
    parser.add_argument("--epochs", type=int, default=14)
    options = parser.parse_args()
    configuration = load_configuration()
    product, bench = load_product(configuration), configuration.bench
    began_s = time.process_time()
    sizes = ((options.recordings, 0), (options.recordings // 5, VALIDATION_SEED), (options.recordings // 4, TEST_SEED))
    data, validation, test = (clips(product, bench, options.person, *size) for size in sizes)
    recorded_s = time.process_time() - began_s
    counts = len(product.parts), len(product.positions)
    probe = train(data, validation, *counts, options.epochs)
    part, hole = accuracy(probe, test)
    answer = {
        "person": options.person,
        "clips": [len(one.parts) for one in (data, validation, test)],
        "part": round(part, 3),
        "floor": round(floor(data, test, *counts), 3),
        "hole": round(hole, 3),
        "recording_cpu_s": round(recorded_s, 1),
        "training_cpu_s": round(time.process_time() - began_s - recorded_s, 1),
    }
    print(json.dumps(answer))


if __name__ == "__main__":
    main()
