"""What is told of a run: in its log before the first tick, and at its end by the keys of `cell run --json`."""

from __future__ import annotations

import hashlib
import json
import re
import resource
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import yaml

from bracket_cell.kinds import DETECTORS, files_of
from bracket_cell.learned.inference.onnx_model import digest_of
from bracket_cell.production.bookkeeper import Bookkeeper
from bracket_cell.recording.identity import identity
from bracket_cell.recording.parts import parts_of
from bracket_cell.recording.recorder import Heading, McapRecorder
from bracket_cell.runs.options import Files, RunOptions
from bracket_cell.settings import LogSettings
from bracket_cell.simulator import simulator
from bracket_cell.skills.drivers.gripper_database import SHIPPED, read_frames
from bracket_cell.skills.drivers.settings import CanSettings
from bracket_cell.trees.node_library import own_code
from bracket_cell.trees.rules import RULES
from bracket_cell.watching.lateness import Lateness
from bracket_cell.watching.observer import Observer, Outcome
from bracket_cell.watching.statistics import Fluency, RunStatistics
from bracket_cell.wiring.safety import SAFETY
from bracket_ground.errors import InputError, Place, Problem
from bracket_ground.interfaces.devices import Devices
from bracket_ground.interfaces.robot import PACKAGE, RobotModel
from bracket_ground.interfaces.urdf import FLANGE
from btxml.engine.tree import Tree

Attachments = dict[str, tuple[str, bytes]]  # media type and content by name


def heading(options: RunOptions, files: Files) -> Heading:
    """What a log needs to be run again: files as attachments, the rest as metadata."""
    attachments = _configured(options, files)
    if files.configuration.devices.simulated and options.devices is None:
        attachments |= simulator().attachments(files.configuration.devices.simulation, options.seed)
    for name, text in tree_texts(files.tree).items():
        attachments[name] = ("application/xml", text.encode())
    values = _asked(options, files) | _networks(options, files)
    for file in own_code(files.tree):
        attachments[f"nodes/{file.name}"] = ("text/x-python", file.read_bytes())
        values[f"code.{file.name}.sha256"] = hashlib.sha256(file.read_bytes()).hexdigest()
    return Heading({**values, **identity()}, attachments)


def _configured(options: RunOptions, files: Files) -> Attachments:
    """The configuration and the files that it names, where they lie beside it."""
    configuration = files.configuration
    rows = [row.model_dump(exclude_defaults=True) for row in files.faults.faults]  # a shipped table may become another
    attachments = {
        "configuration.yaml": ("application/yaml", options.configuration.read_bytes()),
        "faults.yaml": ("application/yaml", yaml.safe_dump({"faults": rows}, sort_keys=False).encode()),
        "product.yaml": ("application/yaml", configuration.product.read_bytes()),
    }
    if files.rules.rules:
        text = yaml.safe_dump(files.rules.model_dump(exclude_defaults=True, mode="json"), sort_keys=False)
        attachments[RULES] = ("application/yaml", text.encode())
    attachments[SAFETY] = ("application/json", json.dumps(dict(files.safety.values)).encode())
    attachments |= robot_files(configuration.robot)
    if isinstance(configuration.devices.gripper, CanSettings):
        database = configuration.devices.gripper.database or SHIPPED
        attachments["gripper.dbc"] = ("text/plain", read_frames(database).encode())
    semantic, folder = configuration.planners.semantic, options.configuration.resolve().parent
    meshes = (obstacle.mesh for obstacle in configuration.bench.obstacles)
    for path in (semantic.goals, semantic.confusions, configuration.calibration, *meshes):
        if path is not None and path.exists() and path.resolve().is_relative_to(folder):
            attachments[str(path.resolve().relative_to(folder))] = ("text/plain", path.read_bytes())
    return attachments


def _asked(options: RunOptions, files: Files) -> dict[str, str]:
    """What the run was told."""
    configuration, devices = files.configuration, files.configuration.devices
    values = {
        "product": files.product.name,
        "pace": options.pace,
        "tree": files.tree.short_name(options.tree),
        "perception": _seen_by(options, files),
    }
    values |= {name: told for name in ("site", "bench") if (told := getattr(configuration.log, name))}
    values["production"] = configuration.production.model_dump_json()
    values["safety.sha256"] = files.safety.sha256
    if files.signature is not None:
        values |= {"safety.signed_by": files.signature.by, "safety.signed_utc": files.signature.utc}
    if files.unsafe:
        values["unsafe"] = "; ".join(files.unsafe)
    if devices.simulated or options.devices is not None:
        person = options.person or "as configured"
        values["pixels"] = str(options.pixels).lower()
        values |= {"seed": str(options.seed), "goal": options.goal, "person": person}
    if devices.simulated and options.devices is None:
        values["look"] = simulator().look_name(devices.simulation)
    if options.world is not None:
        values["world"] = str(options.world.resolve())
    if options.resume is not None:
        values |= {"resumes": str(options.resume), "left_off": json.dumps(files.left_off.plain())}
    if options.entries:
        values["entries"] = json.dumps(dict(options.entries))
    return values


def _seen_by(options: RunOptions, files: Files) -> str:
    """The detectors that see, or "truth" where a simulation says what is there."""
    told = files.configuration.devices.simulated and not options.pixels
    return "truth" if told else files.configuration.perception.words


def _networks(options: RunOptions, files: Files) -> dict[str, str]:
    """Kinds of the planners, and digests of all weights."""
    values: dict[str, str] = {}
    seen = _seen_by(options, files) != "truth"
    networks = [files.configuration.perception.files(name) for name in DETECTORS] if seen else []
    for name, planner in files.configuration.planners:
        values[f"planner.{name}"] = planner.kind
        networks.append(files_of(name, planner))
    for network, file in (item for found in networks for item in found.items()):
        values |= _weights(network, file)
    return values


def robot_files(robot: RobotModel) -> Attachments:
    """The robot as it was, with URDF and meshes of one's own."""
    model, text = robot.model_dump(mode="json"), robot.urdf_text
    files = {}
    if not robot.urdf.startswith(PACKAGE):
        model |= {"urdf": "robot/robot.urdf", "flange": FLANGE, "origins_m": {}, "calibration": None, "mount": None}
        for number, mesh in enumerate(sorted(set(re.findall(r'<mesh[^>]*?filename="([^"]+)"', text)))):
            name = f"{number}-{Path(mesh).name}"
            text = text.replace(f'"{mesh}"', f'"{name}"')
            files[f"robot/{name}"] = ("model/mesh", Path(mesh).read_bytes())
        files["robot/robot.urdf"] = ("application/xml", text.encode())
    return files | {"robot.yaml": ("application/yaml", yaml.safe_dump(model).encode())}


def _weights(name: str, file: Path) -> dict[str, str]:
    """Which weights a planner or detector has."""
    digest = digest_of(file.read_bytes())
    return {f"weights.{name}.file": str(file), f"weights.{name}.sha256": digest}


def tree_texts(tree: Tree) -> dict[str, str]:
    """Files of a tree by their names in the log: below the folder that holds all of them."""
    return {f"tree/{tree.short_name(path)}": text for path, text in tree.texts.items()}


def log_path(options: RunOptions, settings: LogSettings) -> Path:
    """Where the log goes; a file that is there stays, unless it was said otherwise.

    Raises:
        InputError: the name is no log's, or a log or its contact sheet has it already.
    """
    path = options.log or _new_log(settings.folder, options.seed)
    if path.suffix != ".mcap":
        raise InputError(Problem(Place(path), "the name of a log ends in .mcap", f"try {path.stem or 'run'}.mcap"))
    taken = next((file for file in (path, *parts_of(path), path.with_suffix(".png")) if file.exists()), None)
    if taken is not None and not options.overwrite:
        raise InputError(Problem(Place(taken), "exists already", "choose another --log"))
    return path


def _new_log(folder: Path, seed: int) -> Path:
    """A name that no log in the folder has yet."""
    stem = f"{datetime.now():%Y%m%d-%H%M%S}-seed{seed}"
    names = (f"{stem}{suffix}.mcap" for suffix in ("", *(f"-{count}" for count in range(2, 1000))))
    return next(folder / name for name in names if not (folder / name).exists())


@dataclass(frozen=True)
class Counts:
    """Observers that count what a summary shows.

    Attributes:
        keeper: knows the brackets of a run that this one goes on with, too.
        judged_before: brackets that were judged at this bench before the first one that it knows.
    """

    statistics: RunStatistics
    lateness: Lateness
    fluency: Fluency
    keeper: Bookkeeper
    judged_before: int = 0

    @property
    def observers(self) -> tuple[Observer, ...]:
        return (self.statistics, self.keeper, self.fluency, self.lateness)

    def job(self, devices: Devices) -> dict[str, object]:
        """How the job was done; of a shift bracket by bracket. Of a job without a goal no bracket is judged."""
        done = devices.report()
        if "correct" in done and self.statistics.inferred_goal is None:
            done |= {"correct": None, "wrong_placements": None}
        judged = [*devices.finished(), done]
        unknown: list[dict[str, object]] = [{}] * -self.judged_before
        shift = self.keeper.report([*unknown, *judged[max(0, self.judged_before) :]])
        return {**done, **self.statistics.report(), **self.fluency.report(), **shift}


def summary_of(
    options: RunOptions,
    files: Files,
    outcome: Outcome,
    counts: Counts,
    devices: Devices,
    recorder: McapRecorder,
    sheet: str,
) -> dict[str, object]:
    """Everything that is reported about a run."""
    speed = outcome.sim_time_s / outcome.wall_time_s if outcome.wall_time_s > 0 else 0.0
    return {
        "finished": outcome.end == "finished",
        "end": outcome.end,
        "reason": outcome.reason,
        "cause": outcome.cause,
        "why": None if outcome.why is None else outcome.why.plain(),
        "condition": outcome.condition,
        "observer_problems": list(outcome.observer_problems),
        **counts.job(devices),
        **counts.lateness.report(),
        "ticks": outcome.ticks,
        "overruns": outcome.overruns,
        "sim_time_s": round(outcome.sim_time_s, 3),
        "wall_time_s": round(outcome.wall_time_s, 3),
        "real_time_factor": round(speed, 2),
        "perception": _seen_by(options, files),
        "pixels": options.pixels,
        "limits": files.safety.sha256,
        "seed": options.seed,
        "peak_rss_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1),
        "log": str(recorder.path),
        "log_parts": recorder.parts,
        "log_complete": recorder.complete,
        "log_shortfall": recorder.shortfall,
        "contact_sheet": sheet,
    }
