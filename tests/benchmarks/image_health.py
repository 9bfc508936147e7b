"""False alarms and misses of the camera's health by look: `python -m tests.benchmarks.image_health --seeds 5`.

Sound frames of a person at work, of seeds from --first-seed on, are judged as they are; then again with one thing
wrong with the camera from some moment on.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.configuration import Configuration, load_configuration, load_product, simulated
from bracket_cell.learned.classical.image_health import ImageHealth
from bracket_cell.wiring.detectors import Detectors
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import HandSample
from bracket_ground.interfaces.product import Product
from tests.benchmarks.perception_accuracy import open_sim

Image = NDArray[np.uint8]
SOUND = 20  # frames before something is wrong
HOLD_FRAMES = 45  # within so many frames it must be told


def scaled(*factors: float) -> Callable[[Image], Image]:
    """Light of another strength or colour."""
    return lambda image: np.clip(image * np.array(factors), 0, 255).astype(np.uint8)


def blurred_by(sigma_px: float) -> Callable[[Image], Image]:
    """A lens out of focus."""
    return lambda image: np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px), np.uint8)


SPOILS: dict[str, Callable[[Image], Image]] = {
    "black": scaled(0.0),
    "white": lambda image: np.full_like(image, 255),
    "half the light": scaled(0.5),
    "gain 1.6": scaled(1.6),
    "red and blue swapped": lambda image: np.ascontiguousarray(image[..., ::-1]),
    "cold light": scaled(0.8, 1.0, 1.25),
    "out of focus": blurred_by(3),
    "pushed aside": lambda image: np.roll(image, 12, axis=1),
}
FROM_THE_START = "out of focus from the start"
BLURRED = blurred_by(3.5)


def frames_of(configuration: Configuration, product: Product, seed: int, count: int) -> list[Frame]:
    """A person at work, as the overhead camera sees it."""
    cell = open_sim(configuration, product, seed, clutter=[])
    clock, camera = cell.devices.clock, cell.devices.overhead
    seen: list[Frame] = []
    while len(seen) < count:
        frame = camera.latest()
        if frame is not None and (not seen or frame.sequence > seen[-1].sequence):
            seen.append(Frame(frame.camera, frame.sequence, frame.time_s, frame.image, frame.world_from_camera))
        clock.sleep_until(clock.now_s() + 0.02)
    cell.close()
    return seen


def hands_in(configuration: Configuration, product: Product, frames: Sequence[Frame]) -> list[list[HandSample]]:
    """The hands that are seen in each frame."""
    tracker = Detectors(configuration.bench, product, configuration.perception).make("hands")
    found = [(tracker.track(frame), *tracker.others) for frame in frames]
    return [[hand for hand in hands if hand is not None] for hands in found]


def told(
    configuration: Configuration, product: Product, frames: Sequence[Frame], hands: Sequence[Sequence[HandSample]]
) -> list[str]:
    """What is said of each frame, by its first word."""
    health = ImageHealth(configuration.bench, product)
    return [health.judge(frame, seen).partition(" ")[0] for frame, seen in zip(frames, hands, strict=False)]


def main() -> None:
    """Parse options and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--looks", nargs="+", default=["nominal", "varied", "hard"])
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--first-seed", type=int, default=950_000)
    parser.add_argument("--frames", type=int, default=90, help="of each seed")
    options = parser.parse_args()
    configuration = load_configuration()
    product = load_product(configuration)
    print(f"| look | false alarms, of frames | {' | '.join([*SPOILS, 'frozen', FROM_THE_START])} |", flush=True)
    print("|---|" + "---|" * (len(SPOILS) + 3))
    for look in options.looks:
        found, false, judged = Counter[str](), Counter[str](), 0
        here = simulated(configuration, look)
        for seed in range(options.first_seed, options.first_seed + options.seeds):
            frames = frames_of(here, product, seed, options.frames)
            hands = hands_in(here, product, frames)
            false.update(word for word in told(here, product, frames, hands) if word)
            judged += len(frames)
            late = frames[SOUND : SOUND + HOLD_FRAMES]
            for name, spoil in SPOILS.items():
                wrong = [replace(frame, image=spoil(frame.image)) for frame in late]
                found[name] += bool(told(here, product, [*frames[:SOUND], *wrong], hands)[-1])
            frozen = [replace(frame, image=frames[SOUND - 1].image) for frame in late]
            blurred = [replace(frame, image=BLURRED(frame.image)) for frame in frames[:SOUND]]
            found[FROM_THE_START] += told(here, product, blurred, hands)[-1] == "blurred"
            found["frozen"] += bool(told(here, product, [*frames[:SOUND], *frozen], hands)[-1])
        cells = " | ".join(f"{found[name]} of {options.seeds}" for name in [*SPOILS, "frozen", FROM_THE_START])
        alarms = ", ".join(f"{count} {word}" for word, count in false.items()) or "0"
        print(f"| `{look}` | {alarms}, of {judged} | {cells} |", flush=True)


if __name__ == "__main__":
    main()
