"""`cell log export`: a log in the formats of other tools, and as data for training."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from bracket_cell.commands.log_terminal import LogArgument, beside, read, say, spared, tell_json
from bracket_cell.commands.options import OUT_HELP, JsonOption, OverwriteOption
from bracket_cell.commands.terminal import Command, console, table
from bracket_cell.packages import LABORATORY
from bracket_ground.errors import InputError, LogError, counted

LOSSY = 3


class ExportFormat(StrEnum):
    """What a log can be written as."""

    csv = "csv"
    parquet = "parquet"
    transitions = "transitions"
    notes = "notes"
    btlog = "btlog"
    video = "video"
    rosbag2 = "rosbag2"
    candump = "candump"
    lerobot = "lerobot"
    training = "training"
    recovered = "recovered"


def export_log(
    log: LogArgument,
    to: Annotated[ExportFormat, typer.Option(help="Format; `cell docs logs` has a line for each.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help=OUT_HELP)] = None,
    overwrite: OverwriteOption = False,
    as_json: JsonOption = False,
) -> int:
    """Write a log for other tools: tables, transitions for Groot2, a video, data for training.

    It goes next to the log by default. For lerobot and training several logs may be named: each is an episode. `cell
    train --recorded DIR` learns from the folder that training writes. recovered is what can be saved of a truncated or
    damaged MCAP file, as a complete one; status 3 if something is lost.
    """
    if to is ExportFormat.recovered:
        return _recover(log, out or beside(log, ".recovered.mcap"), overwrite, as_json)
    from bracket_cell.log.report.export import export

    if to is ExportFormat.training:
        write_training(log, out or beside(log, ".training"), as_json)
        return 0

    if to is ExportFormat.lerobot:
        from bracket_cell.log.training.lerobot import write_lerobot

        _require_each_once(log)
        folder = out or beside(log, ".lerobot")
        rows = write_lerobot([read([path]) for path in log], folder)
        _tell_export(folder, "row", rows, as_json)
        return 0
    tables = {"transitions": ".transitions.parquet", "notes": ".notes.parquet"}
    ending = {"video": ".mp4", "candump": ".can.log", **tables}.get(to, f".{to}")
    target = spared(out or beside(log, ending), log, overwrite)
    count = export(read(log), to.value, target)
    nouns = {"btlog": "transition", "video": "frame", "candump": "frame", "rosbag2": "message"}
    _tell_export(target, nouns.get(to, "row"), count, as_json)
    return 0


def _recover(logs: Sequence[Path], whole: Path, overwrite: bool, as_json: bool) -> int:
    """Each part of a log becomes one of the new log, and is told in a line of its own."""
    from bracket_cell.log.read.reader import files_of
    from bracket_cell.log.read.salvage import recover
    from bracket_cell.recording.parts import part_number, part_path, whole_path

    files = files_of(logs[0]) if len(logs) == 1 else list(logs)
    if len({whole_path(file) for file in files}) > 1:
        raise InputError("these are several logs; recover one after the other")
    named = {file: part_path(whole, part_number(file) or 1) if len(files) > 1 else whole for file in files}
    made = {file: spared(out, files, overwrite) for file, out in named.items()}
    losses = {out: recover(file, out) for file, out in made.items()}
    for out, loss in losses.items():
        kind = f"; this is {loss.foreign}" if loss.foreign else ""
        lines = f"{out}: {'lossy' if loss.lossy else 'nothing is lost'}{kind}", *(f"  {line}" for line in loss.lines())
        tell_json({"recovered": str(out), "lossy": loss.lossy, **loss.plain()}) if as_json else say(*lines)
    return LOSSY if any(loss.lossy for loss in losses.values()) else 0


def write_training(logs: Sequence[Path], out: Path, as_json: bool) -> None:
    """Write what logs of runs give for training, each log once, into a new folder."""
    write_training_data = Command("_recorded", "What `--to training` calls.", comes_with=LABORATORY).load()
    command = shlex.join(["cell", "log", "export", "--to", "training", *map(str, logs), "--out", str(out)])
    _require_each_once(logs)
    manifest = write_training_data((read([log]) for log in logs), out, command)
    console().print(table(str(out), manifest["counts"]))
    for log in manifest["logs"]:
        if log["no_demonstration_because"]:
            console().print(f"{log['name']}: no demonstration: {log['no_demonstration_because']}", highlight=False)
    if as_json:
        tell_json(manifest)


def _require_each_once(logs: Sequence[Path]) -> None:
    """Check the names of logs before any is read, which takes long.

    Raises:
        LogError: one is not there, or is named twice.
    """
    from bracket_cell.log.read.reader import files_of

    named: set[Path] = set()
    for file in (file for log in logs for file in files_of(log)):
        if not file.is_file():
            raise LogError(file, "cannot be read: there is no such file")
        if file.resolve() in named:
            raise LogError(file, "is named twice")
        named.add(file.resolve())


def _tell_export(target: Path, what: str, count: int, as_json: bool) -> None:
    if as_json:
        tell_json({"file": str(target), f"{what}s": count})
    else:
        say(f"{target}: {counted(count, what)}")
