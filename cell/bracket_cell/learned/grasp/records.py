"""Data sets of grasp scenes: JSON lines, so that recorded runs and drawn scenes train the same planners.

The first line says what the file is; every other line is one scene, its parts in one order throughout:

    {"format": "cell.grasp.scenes", "version": 1, "parts": ["o1", "o2", "o3"], "source": "cell lab data grasp ..."}
    {"detections": [{"part": "o1", "confidence": 0.93, "position_m": [0.56, -0.38, 0.016], "yaw_rad": 0.3,
                     "size_m": [0.045, 0.028, 0.02], "box_px": [210, 150, 240, 176]}, ...],
     "truth": [{"part": "o1", "position_m": [0.5601, -0.3802, 0.016], "yaw_rad": 0.303,
                "size_m": [0.045, 0.028, 0.02]}, ...],
     "blockers": [{"width": [1], "length": []}, ...],
     "noise": {"position_m": 0.0004, "yaw_rad": 0.0044, "bottom_m": 0.0, "size_m": 0.0}, "run": "monday-3"}

`position_m` is the middle of the body's bottom. `truth` (how the parts really stood), `blockers` (for every part, by
each candidate that it has, the numbers of the parts that are in the way) and `noise` (standard deviations of the
detections) may be left out; so may `run`, the recording that a scene is from: scenes of one run show the same parts and
are trained on together or not at all. Where `blockers` are missing they are worked out from the truth. Candidates are
"width" and "length", the sides between the fingers, in their middle; with "+" beside it along the part's own axis, with
"-" against it, with "half" half as far (learned/grasp/candidates.py).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Literal

from pydantic import Field

from bracket_cell.learned.grasp.candidates import Candidate
from bracket_cell.learned.grasp.settings import DetectionNoise
from bracket_ground.files.files import whole_or_none
from bracket_ground.files.model import Model
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.product import Product

Vector = tuple[float, float, float]


class Header(Model):
    """The first line.

    Attributes:
        parts: type names that may occur.
        source: the command, log or person that the scenes come from.
    """

    format: Literal["cell.grasp.scenes"] = "cell.grasp.scenes"
    version: Literal[1] = 1
    parts: tuple[str, ...]
    source: str


class StandingRecord(Model):
    """How a part really stood."""

    part: str
    position_m: Vector
    yaw_rad: float
    size_m: Vector


class DetectionRecord(StandingRecord):
    """What the detector answered about a part; fields as in PartDetection."""

    confidence: float = Field(ge=0, le=1)
    box_px: tuple[int, int, int, int]
    embedding: tuple[float, ...] = ()

    @staticmethod
    def of(part: PartDetection) -> DetectionRecord:
        """A detection as it is written."""
        pose = part.world_from_part
        return DetectionRecord(
            part=part.part,
            position_m=pose.position_m,
            yaw_rad=pose.yaw_rad,
            size_m=part.size_m,
            confidence=part.confidence,
            box_px=part.box_px,
            embedding=part.embedding,
        )

    def detection(self) -> PartDetection:
        """The detection that was written."""
        pose = Pose.from_yaw(self.position_m, self.yaw_rad)
        return PartDetection(self.part, self.confidence, pose, self.size_m, self.box_px, self.embedding)


class SceneRecord(Model):
    """One scene; see the module's text."""

    run: str | None = None

    detections: tuple[DetectionRecord, ...] = Field(min_length=1)
    truth: tuple[StandingRecord, ...] | None = None
    blockers: tuple[dict[Candidate, tuple[int, ...]], ...] | None = None
    noise: DetectionNoise | None = None

    def problems(self, parts: Sequence[str]) -> Iterator[str]:
        """What does not fit together, in words."""
        count = len(self.detections)
        if unknown := sorted({record.part for record in (*self.detections, *(self.truth or ()))} - set(parts)):
            yield f"unknown part types {unknown}; legal: {', '.join(parts)}"
        for name, values in (("truth", self.truth), ("blockers", self.blockers)):
            if values is not None and len(values) != count:
                yield f"{len(values)} entries of {name!r} for {count} detections"
        for part, candidates in enumerate(self.blockers or ()):
            for candidate, numbers in candidates.items():
                if wrong := [number for number in numbers if not 0 <= number < count or number == part]:
                    yield f"part {part}, {candidate}: {wrong} are no numbers of other parts; legal: 0 to {count - 1}"


def write_records(path: Path, records: Iterable[SceneRecord], product: Product, source: str) -> int:
    """Write records, recorded ones for example; returns their number. What was there before stays whole until then."""
    path.parent.mkdir(parents=True, exist_ok=True)
    count = 0
    with whole_or_none(path) as partial, partial.open("w", encoding="utf-8") as file:
        file.write(Header(parts=tuple(product.parts), source=source).model_dump_json() + "\n")
        for record in records:
            file.write(record.model_dump_json(exclude_none=True) + "\n")
            count += 1
    return count
