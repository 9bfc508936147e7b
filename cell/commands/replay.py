"""`cell replay`: tick a log again, and walk through it."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Annotated

import typer

from cell.commands.log_terminal import FromOption, LogArgument, UntilOption, read, say, tell_comparison
from cell.commands.options import JsonOption, WithOption, own_files
from cell.errors import InputError
from cell.log.read.frames import Frames
from cell.log.read.reader import Log
from cell.log.replay.replay import Changes, Replay, Step
from cell.log.report.text import change_lines, command_text, difference_lines, note_text, short

LONGEST_VALUE = 200


def replay(
    log: LogArgument,
    tree: Annotated[Path | None, typer.Option(help="Tree file to tick instead of the recorded tree.")] = None,
    config: Annotated[Path | None, typer.Option(help="Configuration instead of the recorded one.")] = None,
    weights: Annotated[
        list[str] | None, typer.Option(help="PLANNER=FILE: weights instead of the recorded ones; may be repeated.")
    ] = None,
    from_s: FromOption = 0.0,
    until_s: UntilOption = float("inf"),
    bracket: Annotated[int | None, typer.Option(min=1, help="Begin with this bracket of a shift.")] = None,
    step: Annotated[bool, typer.Option("--step", help="Show every tick that changed something, one by one.")] = False,
    frames: Annotated[
        Path | None, typer.Option(help="With --step: folder for what the cameras saw in each shown tick (JPEG).")
    ] = None,
    own: WithOption = None,
    as_json: JsonOption = False,
) -> int:
    """Run the tree again on a log's inputs and compare every decision; status 1 if one differs."""
    recorded = read(log)
    again = Replay(recorded, Changes(tree, config, _weights(weights or []), *own_files(own)), bracket)
    comparison = again.run(from_s, until_s, _shower(recorded, frames) if step else lambda _: None)
    sys.stderr.writelines(f"cell: {recorded.path}: {remark}\n" for remark in again.remarks)
    piece = step or from_s > 0 or until_s < float("inf")
    of = None if piece else recorded.ticks_of_run - again.first
    return tell_comparison(comparison, recorded.unfinished, as_json, ticks_of_run=of, altered=recorded.altered)


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
