"""One tracker of two sources: MediaPipe's networks and the small ones look for hands, and both judge each of them.

They miss different hands: MediaPipe's were taught by photographs of bare ones, the small ones by drawn benches, gloves
and sleeves among them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from bracket_cell.learned.hands.mediapipe.hands import LEAST_PRESENCE
from bracket_cell.learned.hands.mediapipe.palms import PLAIN, Tint
from bracket_cell.learned.hands.mediapipe.tracker import MediaPipeReader, completed, mediapipe_hands
from bracket_cell.learned.hands.model import NEAR_PX, SURE, SlimReader
from bracket_cell.learned.hands.reading import Reading
from bracket_cell.learned.hands.regions import Image
from bracket_cell.learned.hands.tracking import HandTracks, matched
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product

# Of MediaPipe's palms; its landmark network has the last word. At .2 it finds 75 of 86 hands on a bench from above, at
# its own .5 67, and in 160 pictures of tools and things no more that are none.
LEAST_PALM, MOST_HANDS = 0.2, 4
# MediaPipe's networks were taught by bare hands. A second look makes what is white as dark and red as skin: gloves, and
# hands before a camera that sees no colours. Of eight such colours, the one that found most gloves of three sources.
SKIN: Tint = (0.71, 0.47, 0.37)
NEW_CONFIDENCE = 0.9  # of a hand that was not seen before, by both together
SAME_PX = 50.0  # between the centres of one hand as both see it; two hands at one work are nearer to each other seldom
# MediaPipe's presence of a hand in a square where the small networks alone see one: on photographs of tools and rooms
# it was less than this for 75 of 92 things, and for 6 of 124 hands; it was chosen in view of them.
REFUSED = 0.03
UNSURE = 0.8  # confidence at most of what the small networks see and MediaPipe neither refuses nor sees


def joint_tracker(bench: Bench, product: Product, files: Mapping[str, Path]) -> HandTracks:
    """A tracker with the networks of `mediapipe_files`.

    Raises:
        ModelError: MediaPipe's were not fetched yet, or the small ones cannot be used.
    """
    theirs = MediaPipeReader(bench.overhead, mediapipe_hands(files, MOST_HANDS, LEAST_PALM, (PLAIN, SKIN)))
    ours = SlimReader(bench.overhead, tuple(product.parts), files["hands.closer"])
    return HandTracks(bench, JointReader(ours, theirs), ours.palm_length, NEW_CONFIDENCE, repeated=True)


class JointReader:
    """Reads the hands of a stream of images by two readers (HandReader)."""

    def __init__(self, ours: SlimReader, theirs: MediaPipeReader) -> None:
        self._ours, self._theirs = ours, theirs

    def prepare(self, image: Image) -> None:
        """Let the small networks do what follows from the image alone."""
        self._ours.prepare(image)

    def read(self, image: Image, expected_px: Sequence[Array] = ()) -> list[Reading]:
        """All hands in an RGB image, surest first."""
        ours, theirs = self._ours.read(image, expected_px), self._theirs.read(image, expected_px)
        pairs = matched([our.centre_px for our in ours], [their.centre_px for their in theirs], SAME_PX)
        paired, answered = {a for a, _ in pairs}, {b for _, b in pairs}
        found = [agreed(ours[a], theirs[b]) for a, b in pairs]
        found += [completed(their, self._ours, image) for b, their in enumerate(theirs) if b not in answered]
        for unpaired in (our for a, our in enumerate(ours) if a not in paired):
            followed = any(float(np.linalg.norm(unpaired.centre_px - at)) < NEAR_PX for at in expected_px)
            found += [unpaired] if followed else self._asked(image, unpaired)
        return _apart(sorted(found, key=lambda reading: -reading.confidence))

    def _asked(self, image: Image, reading: Reading) -> list[Reading]:
        """What the small networks see alone, as far as MediaPipe believes it."""
        seen = self._theirs.read_at(image, reading)
        if seen is None or seen.confidence < REFUSED:
            return []
        believed = seen.confidence >= LEAST_PRESENCE
        return [agreed(reading, seen) if believed else replace(reading, confidence=min(reading.confidence, UNSURE))]


def agreed(ours: Reading, theirs: Reading) -> Reading:
    """A hand that both see: that neither is right is as likely as if they erred independently."""
    confidence = 1 - (1 - ours.confidence) * (1 - theirs.confidence)
    points = ours.points_px if ours.confidence >= SURE else {**ours.points_px, **theirs.points_px}
    return replace(ours, confidence=confidence, points_px=points)


def _apart(found: Sequence[Reading]) -> list[Reading]:
    """Without those that lie where a surer one does."""
    kept: list[Reading] = []
    for reading in found:
        if all(float(np.linalg.norm(reading.centre_px - other.centre_px)) >= NEAR_PX for other in kept):
            kept.append(reading)
    return kept
