"""How human does the simulated hand look? `python -m tests.benchmarks.human_hand --look varied`

MediaPipe's networks know human hands: on rendered ones they should find as many, and put their landmarks as near to the
true joints, as on photographs. Prints a row for each hand and size of network; the drawn hand has wrist and two
fingertips to compare.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from bracket_cell.configuration import Configuration, load_configuration, load_product, simulated
from bracket_cell.learned.hands.mediapipe.hands import SIZES, MediaPipeHands, model_folder
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Array
from bracket_lab.drawing.hands import HandTruth, hand_frames
from bracket_lab.drawing.recording import Source, record
from bracket_sim.scene.settings import settings_of

HANDS = ("human", "drawn")
LEAST_VISIBLE, EDGE_PX, FOUND_PX = 0.5, 10.0, 30.0
KNOWN = {"wrist": 0, "thumb": 4, "index": 8}  # landmarks by the names that both hands have
PALM = [0, 5, 9, 13, 17]


@dataclass
class Score:
    """What one network made of one hand."""

    hands: int = 0
    errors_px: list[Array] = field(default_factory=list)

    def add(self, network: MediaPipeHands, frame: Frame, true: HandTruth) -> None:
        """One more frame."""
        self.hands += 1
        palm = np.array(true.points_px["palm"])
        found = [landmarks.points_px for landmarks in network.picture(frame.image)]
        near = [one for one in found if np.linalg.norm(one[PALM].mean(axis=0) - palm) < FOUND_PX]
        if not near:
            return
        joints = np.array(true.joints_px or [true.points_px[name] for name in KNOWN])
        chosen = near[0] if true.joints_px else near[0][list(KNOWN.values())]
        self.errors_px.append(np.linalg.norm(chosen - joints, axis=1))

    def row(self) -> str:
        """For people."""
        told = f"found {len(self.errors_px)} of {self.hands}"
        if not self.errors_px:
            return told
        errors = np.array(self.errors_px)
        by_joint = ", ".join(f"{value:.1f}" for value in np.median(errors, axis=0))
        return f"{told}, landmarks off {np.median(errors):.1f} px, 90 % {np.percentile(errors, 90):.1f} px: {by_joint}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--look", default="nominal")
    parser.add_argument("--first-seed", type=int, default=31)
    parser.add_argument("--persons", type=int, default=3)
    parser.add_argument("--frames", type=int, default=8, help="of each person")
    arguments = parser.parse_args()
    configuration = simulated(load_configuration(), None if arguments.look == "nominal" else arguments.look)
    networks = {size: MediaPipeHands(model_folder(), size) for size in SIZES}
    for hand in HANDS:
        scores = {size: Score() for size in SIZES}
        for seed in range(arguments.first_seed, arguments.first_seed + arguments.persons):
            for frame, true in seen_hands(configuration, hand, seed, arguments.frames):
                for size, network in networks.items():
                    scores[size].add(network, frame, true)
        for size, score in scores.items():
            print(f"{arguments.look}, {hand} hand, MediaPipe {size}: {score.row()}")


def seen_hands(configuration: Configuration, hand: str, seed: int, count: int) -> Iterator[tuple[Frame, HandTruth]]:
    """Frames spread over one assembly of a person with bare hands, and the hand that works, where it is in view."""
    bench, settings, product = (
        configuration.bench,
        settings_of(configuration.devices.simulation),
        load_product(configuration),
    )
    looks = settings.look.fixed("person.hand", hand).fixed("person.glove", value=False)
    source = Source(record(product, bench, settings.model_copy(update={"look": looks}), seed), product, bench)
    moments = len(source.assembly.moments)
    low, high = EDGE_PX, np.array([bench.overhead.width_px, bench.overhead.height_px]) - EDGE_PX
    chosen = np.linspace(0.05 * moments, 0.95 * moments, count).astype(int)
    for seen in hand_frames(source, [range(index, index + 1) for index in chosen]):
        for truth in seen.hands:
            points = np.array(list(truth.points_px.values()))
            if truth.acting and truth.visible > LEAST_VISIBLE and ((points > low) & (points < high)).all():
                yield seen.frame, truth


if __name__ == "__main__":
    main()
