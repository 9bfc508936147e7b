"""Training data from recorded runs: demonstrations, segments, crops and scenes, with a manifest that says whose labels.

DIR/demonstrations.jsonl  ordered placements with their goal        cell lab train semantic --data
DIR/scenes.jsonl          parts in the tray, look by look           cell lab train grasp --data
DIR/grasps.jsonl          grasps that were tried in these scenes, and whether they came off
DIR/segments.jsonl        45 frames of hand track with the action  cell lab train actions --data
DIR/windows/              what these look at around the fingertips, as PNG files
DIR/crops.jsonl, crops/   hands and parts as PNG files
DIR/scenes/000001.png     the image of each scene, by its number
DIR/manifest.json         counts, hashes of the logs, origin of every label, what was left out and why
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2

from bracket_cell.learned.actions.segments import holes_on_bench
from bracket_cell.learned.grasp.records import SceneRecord, write_records
from bracket_cell.learned.semantic.goals import OpenGoals
from bracket_cell.learned.semantic.records import Demonstration, save_demonstrations
from bracket_cell.log.read.reader import Log
from bracket_cell.log.replay.logged_tree import logged_bench, logged_product
from bracket_cell.log.report.demonstrations import SURE, demonstration_of, finished_bracket
from bracket_cell.recording.parts import whole_path
from bracket_ground.errors import InputError, LogError, Place, Problem, mistakes
from bracket_ground.files.files import MANIFEST, read_text, whole_folder
from bracket_ground.interfaces.product import Product
from bracket_lab.recorded.segments import STRIDE_FRAMES, Cropper, bench_views, segments
from bracket_lab.recorded.tray_scenes import attempts, looks, scene_records

FORMAT, VERSION = "cell.training_data", 1
# Label by label, who said so. "machine" was never seen by a person.
LABELS = {
    "demonstrations.goal": "machine: all holes as read hold what the goal wants ('all holes'), or the planner's belief "
    f"at the end was {SURE} or more ('belief'); see logs[].goal_known_by",
    "demonstrations.placements": "machine: action detector, hole reader or the robot itself (story of the log); "
    "corrected and contradicted placements are left out",
    "segments.detected": "machine: action detector of the run",
    "segments.confirmed": "machine: the hole reader, when the hole was next seen free of the hand; null where no "
    "assembly was detected or the hole was not seen again",
    "crops.part": "machine: hand tracker (what the hand holds) or part detector of the run",
    "crops.confirmed": "machine: for hands, the part that the hole reader saw after this carry; else null",
    "crops.world_from_part": "machine: part detector of the run",
    "grasps.succeeded": "machine: the skill's own check that the gripper holds the part",
    "scenes.detections": "machine: part detector of the run",
    "scenes.truth": "machine: mean of all looks of the log at a part that nobody moved; nothing was measured",
}


@dataclass
class Collected:
    """What the logs gave so far."""

    demonstrations: list[Demonstration] = field(default_factory=list)
    scenes: list[SceneRecord] = field(default_factory=list)
    grasps: list[dict[str, Any]] = field(default_factory=list)
    segments: list[dict[str, Any]] = field(default_factory=list)
    crops: list[dict[str, Any]] = field(default_factory=list)
    logs: list[dict[str, Any]] = field(default_factory=list)
    goals: OpenGoals | None = None


def write_training_data(logs: Iterable[Log], folder: Path, command: str) -> dict[str, Any]:
    """Write everything and the manifest, which is also the answer; logs are read one after the other.

    Args:
        command: what was typed, for the headers of the files.

    Raises:
        LogError: a log lacks its product, was recorded with another product than the first one, or is named twice.
        InputError: the folder is not empty or cannot be written.
    """
    collected = Collected()
    product: Product | None = None
    try:
        with whole_folder(folder) as partial:
            for log in logs:
                product = _same_product(log, product)
                collected.goals = _learned(log, collected.goals or OpenGoals.of(product))
                _collect(log, product, partial, collected)
            if product is None:
                raise InputError("no log was named; name one with --from LOG")
            return _write(collected, product, partial, command)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from None


def logs_by_hash(folder: Path) -> dict[str, str]:
    """Files of the logs that a folder of training data was made of, by SHA-256; none where it was drawn.

    Raises:
        InputError: its manifest is damaged.
    """
    path = folder / MANIFEST
    if not path.exists():
        return {}
    try:
        logs = json.loads(read_text(path)).get("logs", ())
        return {sha256: file for log in logs for file, sha256 in log["files"].items()}
    except (ValueError, AttributeError, KeyError, TypeError) as error:
        raise InputError(Problem(Place(path), f"is not a manifest of training data: {mistakes(error)[0]}")) from error


def _same_product(log: Log, product: Product | None) -> Product:
    found = logged_product(log)
    if product is not None and found != product:
        raise LogError(log.path, f"was recorded with another product than the first log ({product.name})")
    return found


def _learned(log: Log, goals: OpenGoals) -> OpenGoals:
    """The goals after what this log shows as finished."""
    parts = finished_bracket(log, goals.listed)
    try:
        return goals if parts is None else goals.with_bracket(parts)
    except InputError:  # a hole was misread: no bracket of this product can end so
        return goals


def _collect(log: Log, product: Product, folder: Path, collected: Collected) -> None:
    files = {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in log.parts or (log.path,)}
    if {*files.values()} & {sha256 for log in collected.logs for sha256 in log["files"].values()}:
        raise LogError(log.path, "is named twice, or is a copy of another")
    name = _unused_name(whole_path(log.path).stem, collected.logs)
    taken = demonstration_of(log, collected.goals.product if collected.goals else product)
    if taken.demonstration is not None:
        collected.demonstrations.append(taken.demonstration)
    views = bench_views(log)
    found = list(segments(views))
    cropper = Cropper(log, folder, name)
    crops = list(cropper.hands(views, {segment.views[-1].sequence for segment in found}))
    bench = logged_bench(log)
    holes_m = holes_on_bench(bench, product)
    rows = [segment.row(name, cropper.windows(segment, bench, holes_m)) for segment in found]
    crops += _scenes(log, name, folder, cropper, collected)
    collected.segments += rows
    collected.crops += crops
    collected.logs.append(
        {
            "name": name,
            "files": files,
            "end": log.outcome.get("end", "cut off"),
            "duration_s": round(log.ticks[-1].time_s - log.ticks[0].time_s, 3) if log.ticks else 0.0,
            "perception": log.metadata.get("perception", "unknown"),
            "unfinished": log.unfinished,
            "goal": taken.demonstration.goal if taken.demonstration else None,
            "goal_known_by": taken.goal_known_by or None,
            "no_demonstration_because": taken.why_not or None,
            "segments": len(rows),
            "crops": len(crops),
        }
    )


def _scenes(log: Log, name: str, folder: Path, cropper: Cropper, collected: Collected) -> list[dict[str, Any]]:
    """Add the scenes of a log and the grasps that were tried in them; returns the rows of their crops."""
    views = [view for view in looks(log) if view.detections]
    crops, numbers = [], {}
    for view, record in zip(views, scene_records(views), strict=True):
        collected.scenes.append(record.model_copy(update={"run": name}))
        number = numbers[view.sequence] = len(collected.scenes)
        crops += list(cropper.parts(view, number))
        image = cropper.image("wrist", view.time_s)
        if image is not None:
            path = folder / "scenes" / f"{number:06d}.png"
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(cv2.imencode(".png", image)[1].tobytes())
    collected.grasps += [attempt.row(name, numbers[attempt.view.sequence]) for attempt in attempts(log)]
    return crops


def _write(collected: Collected, product: Product, folder: Path, command: str) -> dict[str, Any]:
    if collected.goals is not None and collected.goals.finished:
        collected.goals.save(folder / "goals.yaml")
    if collected.demonstrations and collected.goals is not None:
        path = folder / "demonstrations.jsonl"
        save_demonstrations(path, collected.goals.product, collected.demonstrations, command)
    if collected.scenes:
        write_records(folder / "scenes.jsonl", collected.scenes, product, command)
    _lines(folder / "grasps.jsonl", "cell.grasps", collected.grasps, command)
    _lines(folder / "segments.jsonl", "cell.segments", collected.segments, command)
    _lines(folder / "crops.jsonl", "cell.crops", collected.crops, command)
    manifest = {
        "format": FORMAT,
        "version": VERSION,
        "made_by": command,
        "product": product.name,
        "counts": _counts(collected),
        "segment_stride_frames": STRIDE_FRAMES,
        "labels": LABELS,
        "logs": collected.logs,
    }
    (folder / MANIFEST).write_text(json.dumps(manifest, indent=2) + "\n", encoding="utf-8")
    return manifest


def _counts(collected: Collected) -> dict[str, Any]:
    """How much there is, and of what."""
    kinds = Counter(row["detected"]["kind"] for row in collected.segments)
    judged = [row["confirmed"]["agrees"] for row in collected.segments if row["confirmed"]]
    return {
        "logs": len(collected.logs),
        "demonstrations": len(collected.demonstrations),
        "placements": sum(len(demonstration.placements) for demonstration in collected.demonstrations),
        "segments": len(collected.segments),
        "segments_by_action": dict(sorted(kinds.items())),
        "assemblies_confirmed": sum(judged),
        "assemblies_contradicted": len(judged) - sum(judged),
        "crops_of_hands": sum(row["kind"] == "hand" for row in collected.crops),
        "crops_of_parts": sum(row["kind"] == "part" for row in collected.crops),
        "scenes": len(collected.scenes),
        "grasps": len(collected.grasps),
        "grasps_that_failed": sum(not row["succeeded"] for row in collected.grasps),
    }


def _lines(path: Path, what: str, rows: Sequence[Mapping[str, Any]], command: str) -> None:
    """JSON lines with a header, where there are any."""
    if rows:
        header = {"format": what, "version": VERSION, "source": command}
        path.write_text("".join(json.dumps(row) + "\n" for row in (header, *rows)), encoding="utf-8")


def _unused_name(stem: str, logs: Sequence[Mapping[str, Any]]) -> str:
    """The log's name, made different from those before it."""
    used = {log["name"] for log in logs}
    names = (stem, *(f"{stem}-{count}" for count in range(2, len(logs) + 3)))
    return next(name for name in names if name not in used)
