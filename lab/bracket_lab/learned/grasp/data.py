"""Scenes for training, written to files of records and read from them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bracket_cell.learned.grasp.boxes import Blocks, Boxes
from bracket_cell.learned.grasp.candidates import CANDIDATES, Candidate, touching
from bracket_cell.learned.grasp.records import DetectionRecord, Header, SceneRecord, StandingRecord, write_records
from bracket_cell.learned.grasp.settings import DetectionNoise, GripperOutline
from bracket_cell.learned.records import read_rows
from bracket_ground.errors import InputError, Place, Problem
from bracket_ground.interfaces.product import Product
from bracket_lab.learned.grasp.scenes import Scene


def write_scenes(path: Path, scenes: Iterable[Scene], product: Product, source: str) -> int:
    """Write scenes with truth and labels; returns their number.

    Args:
        source: where they come from, for whoever opens the file.
    """
    return write_records(path, (record_of(scene) for scene in scenes), product, source)


def read_scenes(path: Path, product: Product, outline: GripperOutline | None = None) -> list[Scene]:
    """All scenes of a file, for training.

    Raises:
        InputError: the file cannot be read, or scenes are damaged or without truth and labels; all with their lines.
    """
    types = tuple(product.parts)

    def header(read: dict[str, Any]) -> None:
        found = Header.model_validate(read)
        if found.parts != types:
            raise ValueError(f"scenes of part types {', '.join(found.parts)}; the product has {', '.join(types)}")

    def made(record: SceneRecord) -> Scene:
        if wrong := list(record.problems(types)):
            raise ValueError("; ".join(wrong))
        if (scene := scene_of(record, outline or GripperOutline())) is None:
            raise ValueError("no truth and no blockers; training needs one of them")
        return scene

    scenes = read_rows(path, SceneRecord, made, header=header)
    if not scenes:
        raise InputError(Problem(Place(path, 1), "the file holds no scenes"))
    return scenes


def record_of(scene: Scene) -> SceneRecord:
    """A scene with truth and labels as it is written."""
    boxes = scene.boxes
    truth = tuple(
        StandingRecord(
            part=boxes.types[i],
            position_m=(float(boxes.centre_m[i, 0]), float(boxes.centre_m[i, 1]), float(boxes.bottom_m[i])),
            yaw_rad=float(boxes.yaw_rad[i]),
            size_m=(float(boxes.size_m[i, 0]), float(boxes.size_m[i, 1]), float(boxes.size_m[i, 2])),
        )
        for i in range(len(boxes))
    )
    detections = tuple(DetectionRecord.of(part) for part in scene.parts)
    blockers = _written(scene.blocks)
    return SceneRecord(run=scene.run or None, detections=detections, truth=truth, blockers=blockers, noise=scene.noise)


def scene_of(record: SceneRecord, outline: GripperOutline) -> Scene | None:
    """The scene for training; None where neither truth nor labels are known.

    Where there are labels alone, the detections stand for the truth.
    """
    seen = tuple(seen.detection() for seen in record.detections)
    if record.truth is None and record.blockers is None:
        return None
    boxes = _boxes(record.detections if record.truth is None else record.truth)
    blocks = touching(boxes, outline) if record.blockers is None else _read_blocks(record.blockers)
    return Scene(boxes, blocks, seen, record.noise or DetectionNoise(), record.run or "")


def _boxes(standing: Sequence[StandingRecord]) -> Boxes:
    position = np.array([record.position_m for record in standing])
    return Boxes(
        tuple(record.part for record in standing),
        position[:, :2],
        np.array([record.yaw_rad for record in standing]),
        position[:, 2],
        np.array([record.size_m for record in standing]),
    )


def _written(blocks: Blocks) -> tuple[dict[Candidate, tuple[int, ...]], ...]:
    """Labels as numbers of blockers; a candidate that does not exist is left out."""
    return tuple(
        {
            candidate: tuple(int(j) for j in np.flatnonzero(blocks[i, number]))
            for number, candidate in enumerate(CANDIDATES)
            if not blocks[i, number, i]
        }
        for i in range(len(blocks))
    )


def _read_blocks(blockers: Sequence[dict[Candidate, tuple[int, ...]]]) -> Blocks:
    blocks = np.zeros((len(blockers), len(CANDIDATES), len(blockers)), dtype=bool)
    for i, candidates in enumerate(blockers):
        for number, candidate in enumerate(CANDIDATES):
            blocks[i, number, list(candidates.get(candidate, (i,)))] = True
    return blocks
