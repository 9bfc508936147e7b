"""`cell replay` and `cell log ...`: each command imports what it needs by itself."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cell.interfaces.errors import InputError

if TYPE_CHECKING:
    from cell.log.compare import Comparison
    from cell.log.reader import Log
    from cell.log.replay import Step

DIFFERS = 1
LOSSY = 3
SHOWN_NODES = 15
LONGEST_VALUE = 200


class ExportFormat(StrEnum):
    """What a log can be written as."""

    csv = "csv"
    parquet = "parquet"
    btlog = "btlog"
    video = "video"


log_app = typer.Typer(no_args_is_help=True, help="Question and compare logs.")

LogArgument = Annotated[
    list[Path], typer.Argument(metavar="LOG...", help="Log of a run (MCAP), or parts of it; the first one brings all.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Answer in JSON.")]
FromOption = Annotated[float, typer.Option("--from", help="From this time on [s].")]
UntilOption = Annotated[float, typer.Option("--until", help="Up to this time [s].")]


def replay(
    log: LogArgument,
    tree: Annotated[Path | None, typer.Option(help="Tree file to tick instead of the recorded tree.")] = None,
    config: Annotated[Path | None, typer.Option(help="Configuration instead of the recorded one.")] = None,
    weights: Annotated[
        list[str] | None, typer.Option(help="PLANNER=FILE: weights instead of the recorded ones; may be repeated.")
    ] = None,
    from_s: FromOption = 0.0,
    until_s: UntilOption = float("inf"),
    step: Annotated[bool, typer.Option("--step", help="Show every tick that changed something, one by one.")] = False,
    frames: Annotated[
        Path | None, typer.Option(help="With --step: folder for what the cameras saw in each shown tick (JPEG).")
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """Tick a log again and compare every decision; 0 where all are the same, 1 where they differ."""
    from cell.log.replay import Changes, Replay

    read = _read(log)
    again = Replay(read, Changes(tree, config, _weights(weights or [])))
    comparison = again.run(from_s, until_s, _shower(read, frames) if step else lambda _: None)
    sys.stderr.writelines(f"cell: {read.path}: {remark}\n" for remark in again.remarks)
    return _report(comparison, read.unfinished, as_json)


def report(
    log: LogArgument,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="HTML file; beside the log by default.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Write one HTML page about a run; it needs no network."""
    from cell.log.report import write_report

    page = out or _beside(log, ".html")
    size = write_report(_read(log), page)
    if as_json:
        _line({"report": str(page), "bytes": size})
    else:
        _say(f"{page}: {size / 1e6:.2f} MB")


@log_app.command()
def info(log: LogArgument, as_json: JsonOption = False) -> None:
    """Say what is in a log."""
    from cell.log import question

    answer = question.info(_read(log))
    if as_json:
        _line(answer)
        return
    from cell.log.wording import info_lines

    _say(*info_lines(answer))


@log_app.command()
def ticks(
    log: LogArgument,
    from_s: FromOption = 0.0,
    until_s: UntilOption = float("inf"),
    everything: Annotated[bool, typer.Option("--all", help="Also ticks in which nothing was decided.")] = False,
    as_json: JsonOption = False,
) -> None:
    """List ticks with what was noted, commanded and shown; with --json one object a line."""
    from cell.log import question
    from cell.log.wording import tick_lines

    _lines(question.ticks(_read(log), from_s, until_s, everything), as_json, lambda tick: "\n".join(tick_lines(tick)))


@log_app.command()
def query(
    log: LogArgument,
    node: Annotated[str | None, typer.Option(help="Part of a node's path.")] = None,
    status: Annotated[str | None, typer.Option(help="RUNNING, SUCCESS, FAILURE or INVALID.")] = None,
    key: Annotated[str | None, typer.Option(help="Key that the entry has at any depth.")] = None,
    topic: Annotated[str | None, typer.Option(help="Part of the topic, as belief or command.")] = None,
    from_s: FromOption = 0.0,
    until_s: UntilOption = float("inf"),
    as_json: JsonOption = False,
) -> None:
    """Find status changes of nodes, or messages by topic and key; with --json one object a line."""
    from cell.log import question

    legal = ("RUNNING", "SUCCESS", "FAILURE", "INVALID")
    if status is not None and status not in legal:
        raise InputError(f"--status {status} is no status; legal: {', '.join(legal)}")
    asked = question.Query(node, status, key, topic, from_s, until_s)
    from cell.log.wording import short

    _lines(question.query(_read(log), asked), as_json, lambda entry: short(entry, LONGEST_VALUE))


@log_app.command()
def diff(
    one: Annotated[Path, typer.Argument(metavar="A", help="Log.")],
    other: Annotated[Path, typer.Argument(metavar="B", help="Log to compare with.")],
    as_json: JsonOption = False,
) -> int:
    """Compare what two logs saw and decided, tick by tick; 0 where all is the same, 1 where it differs."""
    from cell.log import question

    logs = _read([one]), _read([other])
    unfinished = "; ".join(log.unfinished for log in logs if log.unfinished)
    return _report(
        question.diff(*logs), unfinished, as_json, (one.name, other.name) if one.name != other.name else ("A", "B")
    )


@log_app.command()
def recover(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Log of a run (MCAP), or one part of it.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="New file; LOG.recovered.mcap by default.")] = None,
    as_json: JsonOption = False,
) -> int:
    """Salvage a truncated or damaged log into a complete file; 0 where nothing is lost, 3 where something is."""
    from cell.log import recover as recovery

    target = out or log.with_suffix(".recovered.mcap")
    loss = recovery.recover(log, target)
    if as_json:
        _line({"recovered": str(target), "lossy": loss.lossy, **vars(loss)})
    else:
        _say(f"{target}: {'lossy' if loss.lossy else 'nothing is lost'}", *(f"  {line}" for line in loss.lines()))
    return LOSSY if loss.lossy else 0


@log_app.command("export")
def export_log(
    log: LogArgument,
    to: Annotated[ExportFormat, typer.Option(help="Format.")],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="File to write; beside the log by default.")] = None,
    as_json: JsonOption = False,
) -> None:
    """Write a log for other tools: a table of ticks, transitions for Groot2, or a video of the overhead camera."""
    from cell.log.export import export

    target = out or _beside(log, ".mp4" if to is ExportFormat.video else f".{to.value}")
    count = export(_read(log), to.value, target)
    what = {ExportFormat.btlog: "transitions", ExportFormat.video: "frames"}.get(to, "rows")
    if as_json:
        _line({"file": str(target), what: count})
    else:
        _say(f"{target}: {count} {what}")


@log_app.command("to-test")
def to_test(
    log: LogArgument,
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder of the case.")] = Path("tests/cases"),
    name: Annotated[str | None, typer.Option(help="Name of the case; the log's by default.")] = None,
    until_s: UntilOption = float("inf"),
    as_json: JsonOption = False,
) -> int:
    """Turn a log into a regression case under 1 MB; `make test` replays those in tests/cases. 1 if it differs now."""
    from cell.log.case import check_case, write_case

    case = out / f"{name or _beside(log, '').name}.mcap"
    size = write_case(_read(log), case, until_s)
    from cell.log.wording import difference_lines

    differing = check_case(case)
    if as_json:
        first = vars(differing[0]) if differing else None
        _line({"case": str(case), "bytes": size, "differences": len(differing), "first": first})
    else:
        _say(f"{case}: {size} bytes", *(line for one in differing[:1] for line in ("differs:", *difference_lines(one))))
    return DIFFERS if differing else 0


def _read(paths: Sequence[Path]) -> Log:
    from cell.log.reader import read_log

    log = read_log(paths[0] if len(paths) == 1 else paths)
    if log.unfinished:
        sys.stderr.write(f"cell: {log.path}: {log.unfinished}\n")
    return log


def _beside(paths: Sequence[Path], suffix: str) -> Path:
    """A file beside a log, named as the log is; as the part is where a later part was named alone."""
    from cell.log.reader import files_of
    from cell.log_parts import whole_path

    alone = len(paths) == 1 and files_of(paths[0]) == [paths[0]]
    return (paths[0] if alone else whole_path(paths[0])).with_suffix(suffix)


def _weights(options: Iterable[str]) -> dict[str, Path]:
    found = {}
    for option in options:
        name, separator, file = option.partition("=")
        if not (name and separator and file):
            raise InputError(f"--weights {option} is not like semantic=FILE or grasp=FILE")
        found[name] = Path(file)
    return found


def _report(comparison: Comparison, unfinished: str, as_json: bool, names: tuple[str, str] = ("was", "now")) -> int:
    from cell.log.wording import difference_lines

    if as_json:
        _line({**comparison.as_json(), "unfinished": unfinished})
    elif comparison.identical:
        _say(f"identical: {comparison.ticks} ticks")
    else:
        assert comparison.first is not None
        _say(f"{comparison.differing_ticks} of {comparison.ticks} ticks differ", "first:")
        _say(*difference_lines(comparison.first, names), "by what differs (number of ticks, first one):")
        for aspect, first in comparison.first_by_aspect.items():
            _say(f"  {aspect}: {comparison.ticks_by_aspect[aspect]}", *difference_lines(first, names))
        if comparison.ticks_by_node:
            _say("by node (ticks):")
            _say(*(f"  {count:6d} {node}" for node, count in comparison.ticks_by_node.most_common(SHOWN_NODES)))
    return 0 if comparison.identical else DIFFERS


def _shower(log: Log, folder: Path | None) -> Callable[[Step], bool]:
    """Shows a step and, at a terminal, waits for Enter; q ends."""
    from cell.log.frames import Frames

    frames, interactive = Frames(log), sys.stdin.isatty()

    def show(step: Step) -> bool:
        if not (step.now.changes or step.now.notes or step.now.command or step.differences):
            return True
        _say(*_step_text(step))
        if folder is not None:
            tick = step.logged
            _say(*(f"  {path}" for path in frames.save(tick.time_s, folder, f"tick{tick.number:06d}")))
        if not interactive:
            return True
        sys.stderr.write("Enter: next tick, q: end ")
        sys.stderr.flush()
        return not sys.stdin.readline().strip().startswith("q")

    return show


def _step_text(step: Step) -> list[str]:
    from cell.log.wording import change_lines, command_text, difference_lines, note_text, short

    tick, now = step.logged, step.now
    seen = tick.observation.bench
    lines = [f"--- tick {tick.number} at {tick.time_s:.2f} s: {now.status}"]
    if seen is not None:
        holes = " ".join(f"{position}={hole.part or '-'}" for position, hole in seen.holes.items())
        hand = "no hand"
        if seen.hand is not None:
            x, y = seen.hand.fingertips_m
            hand = f"hand at ({x:.3f}, {y:.3f}) m, holds {seen.hand.held_part or 'nothing'}"
        lines.append(f"  overhead frame {seen.sequence} of {seen.time_s:.2f} s: {seen.action}; {hand}; {holes}")
    if (parts := tick.observation.parts) is not None:
        lines.append(
            f"  wrist frame {parts.sequence} of {parts.time_s:.2f} s: {' '.join(p.part for p in parts.detections)}"
        )
    lines += [f"  {line}" for line in change_lines(now.changes)]
    lines += [f"  {note_text(topic, fields)}" for topic, fields in now.notes]
    lines += [f"  {command_text(now.command)}"] if now.command else []
    lines += [f"  {{{key}}} = {short(str(value), LONGEST_VALUE)}" for key, value in step.blackboard.items()]
    for difference in step.differences:
        lines += ["  DIFFERS", *difference_lines(difference)]
    return lines


def _lines(entries: Iterable[Mapping[str, Any]], as_json: bool, text: Callable[[Mapping[str, Any]], str]) -> None:
    count = 0
    for count, entry in enumerate(entries, 1):  # noqa: B007 - counted to say where nothing was found
        sys.stdout.write((json.dumps(entry) if as_json else text(entry)) + "\n")
    if not count:
        sys.stderr.write("cell: nothing of that is in the log\n")


def _line(answer: Mapping[str, object]) -> None:
    sys.stdout.write(json.dumps(answer) + "\n")


def _say(*lines: str) -> None:
    sys.stdout.writelines(f"{line}\n" for line in lines)
