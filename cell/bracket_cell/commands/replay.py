"""`cell replay`: tick a log again, and walk through it."""

from __future__ import annotations

import os
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from bracket_cell.commands.log_terminal import (
    DIFFERS,
    FromOption,
    UntilOption,
    logs_argument,
    read,
    say,
    spared,
    tell_comparison,
    tell_json,
)
from bracket_cell.commands.options import CONFIG_HELP, HtmlOption, JsonOption, WithOption, always_loaded, user_files
from bracket_cell.log.read.frames import Frames
from bracket_cell.log.read.reader import Log, files_of
from bracket_cell.log.replay.compare import Difference
from bracket_cell.log.replay.explain import causes, changed_keys, replay_row
from bracket_cell.log.replay.loading import Changes
from bracket_cell.log.replay.replay import Replay, Step
from bracket_cell.log.report.replay_page import write_replay
from bracket_cell.log.report.text import change_lines, command_text, difference_lines, note_text, short
from bracket_cell.recording.parts import whole_path
from bracket_ground.errors import InputError, counted

LONGEST_VALUE = 200
WORKERS = max(1, (os.cpu_count() or 2) // 2)  # processes that replay several logs
MOST_KEPT = 2000  # differences for a page
ManyLogs = Annotated[
    list[Path], logs_argument("Log of a run (MCAP), or parts of it; of several runs one table is made.")
]


def replay(
    log: ManyLogs,
    tree: Annotated[Path | None, typer.Option(help="Tree file to tick instead of the recorded tree.")] = None,
    config: Annotated[Path | None, typer.Option(help=CONFIG_HELP)] = None,
    weights: Annotated[
        list[str] | None, typer.Option(help="PLANNER=FILE: weights instead of the recorded ones; may be repeated.")
    ] = None,
    perception: Annotated[
        str | None,
        typer.Option(
            metavar="KIND|FOLDER",
            help="Let other detectors see the recorded images: classical, learned, or a folder with weights.",
        ),
    ] = None,
    from_s: FromOption = 0.0,
    until_s: UntilOption = float("inf"),
    bracket: Annotated[int | None, typer.Option(min=1, help="Begin with this bracket of a shift.")] = None,
    step: Annotated[bool, typer.Option("--step", help="Show every tick that changed something, one by one.")] = False,
    frames: Annotated[
        Path | None, typer.Option(help="With --step: folder for what the cameras saw in each shown tick (JPEG).")
    ] = None,
    html: HtmlOption = None,
    own: WithOption = None,
    as_json: JsonOption = False,
) -> int:
    """Run the tree again on a log's inputs and compare every decision; status 1 if one differs.

    --tree, --config and --weights take the place of what was recorded. Several logs are answered in one table, with the
    node and the tick of the first other command of each. The page of --html has the first other command, and why.
    """
    changes = _changes(tree, config, weights, own, perception)
    if len(log) > 1 and len({whole_path(path) for path in log}) > 1:
        if step or html is not None or bracket is not None or from_s > 0 or until_s < float("inf"):
            raise InputError("--step, --html, --bracket, --from and --until are questions about one log")
        return _many(log, changes, as_json)
    if html is not None:
        spared(html, log)
    recorded = read(log)
    again = Replay(recorded, changes, bracket)
    changed = changed_keys(again)
    _remark(recorded, again.remarks)
    shown, found = len(again.remarks), list[Difference]()
    show = _shower(recorded, frames) if step else lambda _: True

    def watch(step: Step) -> bool:
        found.extend(step.differences if html is not None and len(found) < MOST_KEPT else ())
        return show(step)

    comparison = again.run(from_s, until_s, watch)
    _remark(recorded, again.remarks[shown:])
    keys, why = list(dict.fromkeys(map(str, changed))), causes(comparison, changed)
    if html is not None:
        write_replay(recorded, comparison, (again.remarks, keys, why), found, html)
    if not as_json:
        _say_safety(recorded)
    piece = step or from_s > 0 or until_s < float("inf") or perception is not None
    of = None if piece else recorded.ticks_of_run - again.first
    return tell_comparison(
        comparison, recorded.unfinished, as_json, ticks_of_run=of, altered=recorded.altered, changed=keys, causes=why
    )


def _changes(
    tree: Path | None, config: Path | None, weights: list[str] | None, own: list[str] | None, perception: str | None
) -> Changes:
    nodes, beside = user_files(own)
    return Changes(tree, config, _weights(weights or []), (*nodes, *always_loaded()), beside, perception)


def _say_safety(log: Log) -> None:
    """The safety configuration of a run, and who signed it."""
    if (sha256 := log.metadata.get("safety.sha256")) is not None:
        by, utc = (log.metadata.get(f"safety.signed_{name}") for name in ("by", "utc"))
        say(
            f"safety configuration {sha256[:12]}, {'not signed: simulated' if by is None else f'signed by {by}, {utc}'}"
        )


def _remark(log: Log, remarks: Iterable[str]) -> None:
    sys.stderr.writelines(f"cell: {log.path}: {remark}\n" for remark in remarks)


def _many(logs: Sequence[Path], changes: Changes, as_json: bool) -> int:
    """A row for each log, and at which node the first other command comes how often."""
    from bracket_cell.fleet.engine import mapped

    paths = list(dict.fromkeys(str(files_of(whole_path(path))[0]) for path in logs))
    rows, nodes = 0, Counter[str]()
    differing = failed = 0
    for row in mapped(replay_row, ((path, changes) for path in paths), WORKERS):
        rows += 1
        failed += bool(row["error"])
        if row["differing_ticks"]:
            differing += 1
            nodes[row["node"] if row["command_tick"] is not None else "no other command"] += 1
        tell_json(row) if as_json else say(_row_text(row))
    if not as_json:
        say(f"{differing} of {rows} logs differ" + (f", {failed} could not be replayed" if failed else ""))
        say(*(f"  {count:4d}  {node or 'no node'}" for node, count in nodes.most_common()))
    return DIFFERS if differing or failed else 0


def _row_text(row: Mapping[str, Any]) -> str:
    name = Path(row["log"]).name
    if row["error"]:
        return f"{name}: cannot be replayed: {row['error']}"
    if not row["differing_ticks"]:
        return f"{name}: identical, {counted(row['ticks'], 'tick')}"
    of = "command" if row["command_tick"] is not None else "first"
    at = f"first other {row[f'{of}_aspect']} at tick {row[f'{of}_tick']}, {row[f'{of}_time_s']:.2f} s"
    why = f"; {row['why']}" if row["why"] else ""
    return f"{name}: {row['differing_ticks']} of {row['ticks']} ticks differ; {at}, {row['node'] or 'no node'}{why}"


def _weights(options: Iterable[str]) -> dict[str, Path]:
    found = {}
    for option in options:
        name, separator, file = option.partition("=")
        if not (name and separator and file):
            raise InputError(f"--weights {option} is not like semantic=FILE or grasp=FILE")
        found[name] = Path(file)
    return found


def _shower(log: Log, folder: Path | None) -> Callable[[Step], bool]:
    """Shows a step and, at a terminal, waits for Enter; q ends."""
    frames, interactive = Frames(log), sys.stdin.isatty()

    def show(step: Step) -> bool:
        if not (step.now.changes or step.now.notes or step.now.command or step.differences):
            return True
        say(*_step_text(step))
        if folder is not None:
            tick = step.logged
            say(*(f"  {path}" for path in frames.save(tick.time_s, folder, f"tick{tick.number:06d}")))
        if not interactive:
            return True
        sys.stderr.write("Enter: next tick, q: end ")
        sys.stderr.flush()
        return not sys.stdin.readline().strip().startswith("q")

    return show


def _step_text(step: Step) -> list[str]:
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
