"""The tree, the product and the bench that a log was recorded with, loaded from the log itself."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any, TypeVar

import yaml

from bracket_cell.configuration import Configuration
from bracket_cell.learned.classical.settings import PerceptionSettings
from bracket_cell.learned.semantic.settings import NewGoals
from bracket_cell.log.read.reader import Log, LogStream
from bracket_cell.log.read.ticks import holding
from bracket_cell.settings import LogSettings
from bracket_cell.skills.drivers.settings import CanSettings
from bracket_cell.skills.motion.settings import MotionSettings, SeparationSettings
from bracket_cell.trees.node_library import node_registry, own_code, python_files
from bracket_cell.trees.rules import RULES, Rules
from bracket_ground.errors import InputError, LogError
from bracket_ground.files.files import read_text
from bracket_ground.files.model import Model
from bracket_ground.files.yaml_file import load_yaml, read_data
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.devices import ROLES
from bracket_ground.interfaces.faults import OFF_PATH, OFF_PATH_LONG, SIGNALS, Fault, FaultTable
from bracket_ground.interfaces.gripper import default_gripper
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.robot import DEFAULT
from bracket_ground.interfaces.robot import FOLDER as ROBOTS
from btxml.engine.node import TreeNode
from btxml.engine.tree import Tree
from btxml.files.check import with_stubs
from btxml.files.loader import build, find_problems
from btxml.files.parse.library import read_library

CONFIGURATION, ROBOT = "configuration.yaml", "robot.yaml"
OF_ROBOT = {"speed_limits_rad_s": "speed_rad_s", "acceleration_limits_rad_s2": "acceleration_rad_s2"}
OF_TOOL = {"tcp_from_tool0_m": "tcp_from_flange_m", "fingertip_beyond_tcp_m": "fingertip_beyond_tcp_m"}
UR10_OF_OLD = "package://example-robot-data/robots/ur_description/urdf/ur10_robot.urdf"
UR10 = "package://ur10/ur10.urdf"
FOLDER, NODES = "tree/", "nodes/"
PRODUCT = "product.yaml"
AnyModel = TypeVar("AnyModel", bound=Model)


def upgrade(log: Log | LogStream, folder: Path) -> None:
    """Rewrite the configuration of a log that was unpacked into a folder.

    Simulator and factory are left out, as a replay opens no devices; the robot is the one that was recorded. Of the
    nodes that it names only the code that the log holds itself is loaded.
    """
    path = folder / CONFIGURATION
    try:
        data = read_data(path, path.read_text("utf-8"))
    except (InputError, UnicodeDecodeError):
        return  # who loads it says what is wrong
    if not isinstance(data, dict):
        return
    own = set(map(_digest, nodes_of(log).values()))
    named = [file.resolve() for name in data.pop("nodes", None) or () for file in python_files(str(name))]
    data["nodes"] = [str(file) for file in named if file.is_file() and _digest(file.read_bytes()) in own]
    devices = {role: device for role, device in (data.pop("devices", None) or {}).items() if role in ROLES}
    for key, role in (("gripper_can", "gripper"), ("signals", "signals")):
        if (settings := data.pop(key, None)) is not None:
            devices[role] = {"kind": "can", **settings}
    for section, model in _with_fixed(data, devices):
        for key in section.keys() & model.__class_vars__:
            del section[key]
    robot = _of_motion(data.get("motion") or {})
    if robot is not None:
        (folder / ROBOT).write_text(yaml.safe_dump(robot), "utf-8")
    if (folder / ROBOT).exists():
        data["robot"] = ROBOT
        recorded = read_data(folder / ROBOT, read_text(folder / ROBOT).replace(UR10_OF_OLD, UR10))
        if (tool := recorded.pop("tool", None)) is not None:
            recorded["gripper"] = default_gripper().model_dump(mode="json") | tool
        (folder / ROBOT).write_text(yaml.safe_dump(recorded), "utf-8")
        data.pop("gripper", None)
    path.write_text(yaml.safe_dump({**data, "devices": devices}), "utf-8")


def _with_fixed(data: dict[str, Any], devices: dict[str, Any]) -> Iterator[tuple[dict[str, Any], type[Model]]]:
    """Sections that held keys in older logs which no file sets any more; a replay says whose values are others now."""
    yield (data.get("perception") or {}).get("classical") or {}, PerceptionSettings
    yield ((data.get("planners") or {}).get("semantic") or {}).get("new_goals") or {}, NewGoals
    yield data.get("log") or {}, LogSettings
    if (gripper := devices.get("gripper") or {}).get("kind") == "can":
        yield gripper, CanSettings


def recorded_table(text: str) -> FaultTable:
    """The table of faults of a log; signs that were unknown when it was written do nothing in it."""
    rows = [dict(row) for row in read_data(Path("table of faults"), text)["faults"]]
    asks_s = {row["signal"]: row.pop("person_after_s", None) for row in rows}
    for row in rows:
        for key in set(row) - set(Fault.model_fields):
            del row[key]
    if (delay_s := asks_s.get(OFF_PATH)) is not None:  # a person was asked for by the same row
        off = next(row for row in rows if row["signal"] == OFF_PATH)
        rows.append({**off, "signal": OFF_PATH_LONG, "clear": "person", "delay_s": min(delay_s, 10.0)})
    unknown = set(SIGNALS) - {row["signal"] for row in rows}
    added = [{"signal": signal, "action": "run", "clear": "itself"} for signal in sorted(unknown)]
    return FaultTable.model_validate({"faults": [*rows, *added]})


def _of_motion(motion: dict[str, Any]) -> Mapping[str, Any] | None:
    """The robot that an older log describes among its motions; None where it does not.

    Its keys are taken away, and those that nobody may set any more.
    """
    limits = {OF_ROBOT[key]: motion.pop(key) for key in OF_ROBOT if key in motion}
    tool = {OF_TOOL[key]: motion.pop(key) for key in OF_TOOL if key in motion}
    for section, model in ((motion, MotionSettings), (motion.get("separation") or {}, SeparationSettings)):
        for key in set(section) - set(model.model_fields):
            del section[key]
    if not limits and not tool:
        return None
    usual = read_data(file := ROBOTS / f"{DEFAULT}.yaml", read_text(file))
    return {**usual, **limits, "tool": tool}


def logged_tree(log: Log | LogStream, more: Iterable[str] = ()) -> Tree:
    """The tree to look at, not to tick: a node that is not here, such as one of the user's own, is a stub.

    Args:
        more: files or packages with further nodes.

    Raises:
        LogError: the log holds no tree, or none that can be told from its files.
        InputError: a file or package with nodes cannot be loaded.
    """
    name = f"{FOLDER}{log.metadata.get('tree')}"
    files = {name: text for name, text in log.attachments.items() if name.startswith(FOLDER)}
    if name not in files:
        raise LogError(log.path, f"holds no tree; it holds: {', '.join(log.attachments) or 'nothing'}")
    with unpacked(log, files) as folder:
        library = read_library(folder / name, (folder / FOLDER,))
        registry = with_stubs(library, node_registry(more=more))
        problems = find_problems(library, registry)  # what is wrong becomes a stub, too
        if library.incomplete or library.main not in library.trees:
            raise InputError(*map(str, problems) if problems else (f"{folder / name}: holds no tree {library.main}",))
    return build(library, registry, library.main, {})[0]


def nodes_of(log: Log | LogStream) -> dict[str, bytes]:
    """The code of the user's own nodes that a log holds, by its name there; nothing of it is run."""
    return {name: content for name, content in log.attachments.items() if name.startswith(NODES)}


def nodes_missing(log: Log | LogStream, named: Iterable[str]) -> list[str]:
    """Of the nodes that a log was recorded with, those whose code is in no file that is named here."""
    here = {_digest(file.read_bytes()) for package in named for file in python_files(package) if file.is_file()}
    return [name for name, content in nodes_of(log).items() if _digest(content) not in here]


def code_differs(log: Log | LogStream, tree: Tree) -> list[str]:
    """Sources of the user's own nodes that are others than in the log, a line each; nothing of the log is run."""
    here = {file.name: _digest(file.read_bytes()) for file in own_code(tree)}
    found = []
    for key, digest in log.metadata.items():
        if key.startswith("code.") and key.endswith(".sha256"):
            name = key.removeprefix("code.").removesuffix(".sha256")
            if here.get(name) != digest:
                found.append(f"{name} is {'another one here' if name in here else 'not used here'}")
    return found


def other_nodes(log: Log | LogStream, tree: Tree) -> Iterator[tuple[TreeNode, str]]:
    """Nodes of a tree whose own code is in a file that the log has otherwise, or not at all, with that file."""
    for node in tree.nodes:
        for file in own_code(tree, (node,)):
            if log.metadata.get(f"code.{file.name}.sha256") != _digest(file.read_bytes()):
                yield node, str(file)


@contextmanager
def unpacked(log: Log | LogStream, files: Mapping[str, bytes]) -> Iterator[Path]:
    """A folder with attachments of a log, for a moment; problems in them are told by the log's name.

    Raises:
        LogError, InputError: see `write_files`; what is raised inside.
    """
    with tempfile.TemporaryDirectory(prefix="cell-log-") as folder:
        write_files(log, files, Path(folder))
        try:
            yield Path(folder)
        except InputError as error:
            if folder not in str(error):
                raise
            raise InputError(str(error).replace(f"{folder}/", f"{log.path}: ")) from None


def write_files(log: Log | LogStream, files: Mapping[str, bytes], folder: Path) -> None:
    """Put attachments of a log into a folder, in folders of their own as their names say; see also `upgrade`.

    Raises:
        LogError: a name leads out of the folder or is none of a file, or the configuration is none.
    """
    for name, content in files.items():
        try:
            target = (folder / name).resolve()
            if not target.is_relative_to(folder.resolve()):
                raise LogError(log.path, f"has an attachment that leads out of its folder: {name!r:.99}")
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(content)
        except (OSError, ValueError) as error:  # a folder of that name, too long, with a NUL
            why = getattr(error, "strerror", None) or error
            raise LogError(log.path, f"has an attachment that can be no file: {name!r:.99}: {why}") from None
    if CONFIGURATION in files:
        with holding(log.path, "its configuration"):
            upgrade(log, folder)


def logged_bench(log: Log) -> Bench:
    """The bench as it was measured.

    Raises:
        LogError: the log holds none.
        InputError: this version cannot read it.
    """
    return _read(log, CONFIGURATION, Configuration).bench


def logged_motion(log: Log) -> MotionSettings:
    """How the arm was moved, and its tool.

    Raises:
        LogError: the log holds no configuration.
        InputError: this version cannot read it.
    """
    read = _read(log, CONFIGURATION, Configuration)
    robot = read.robot if read.gripper is None else read.robot.model_copy(update={"gripper": read.gripper})
    return read.motion.of(robot, *read.timing_s)


def logged_product(log: Log) -> Product:
    """The product that was assembled.

    Raises:
        LogError: the log holds none.
        InputError: this version cannot read it.
    """
    return _read(log, PRODUCT, Product)


def logged_rules(log: Log) -> Rules:
    """The rules of the run; none where it had none.

    Raises:
        LogError, InputError: this version cannot read them.
    """
    return _read(log, RULES, Rules) if RULES in log.attachments else Rules()


def _read(log: Log, name: str, kind: type[AnyModel]) -> AnyModel:
    if name not in log.attachments:
        raise LogError(log.path, f"holds no {name}; it holds: {', '.join(log.attachments) or 'nothing'}")
    files = {name: content for name, content in log.attachments.items() if not name.startswith(FOLDER)}
    with unpacked(log, files) as folder:
        return load_yaml(folder / name, kind)


def _digest(content: bytes) -> str:
    return sha256(content).hexdigest()
