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
from bracket_ground.errors import LogError

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
        return _recover(log[0], out or log[0].with_suffix(".recovered.mcap"), as_json)
    from bracket_cell.log.report.export import export

    if to is ExportFormat.training:
        write_training(log, out or beside(log, ".training"), as_json)
        return 0

    if to is ExportFormat.lerobot:
        from bracket_cell.log.training.lerobot import write_lerobot

        folder = out or beside(log, ".lerobot")
        rows = write_lerobot([read([path]) for path in log], folder)
        _tell_export(folder, "rows", rows, as_json)
        return 0
    tables = {ExportFormat.transitions, ExportFormat.notes}
    endings = {ExportFormat.video: ".mp4", ExportFormat.candump: ".can.log"}
    ending = endings.get(to, f".{to.value}.parquet" if to in tables else f".{to.value}")
    target = spared(out or beside(log, ending), log, overwrite)
    count = export(read(log), to.value, target)
    words = {"btlog": "transitions", "video": "frames", "candump": "frames", "rosbag2": "messages"}
    what = words.get(to.value, "rows")
    _tell_export(target, what, count, as_json)
    return 0


def _recover(log: Path, target: Path, as_json: bool) -> int:
    from bracket_cell.log.read.salvage import recover

    loss = recover(log, target)
    if as_json:
        tell_json({"recovered": str(target), "lossy": loss.lossy, **loss.plain()})
    else:
        kind = f"; this is {loss.foreign}" if loss.foreign else ""
        say(f"{target}: {'lossy' if loss.lossy else 'nothing is lost'}{kind}", *(f"  {line}" for line in loss.lines()))
    return LOSSY if loss.lossy else 0


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
        tell_json({"file": str(target), what: count})
    else:
        say(f"{target}: {count} {what}")
