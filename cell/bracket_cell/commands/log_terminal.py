"""What the commands about logs share: arguments, reading with a word about what is missing, and answers."""

from __future__ import annotations

import atexit
import json
import math
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bracket_cell.commands.terminal import complain, printable
from bracket_ground.errors import InputError, LogError, counted

if TYPE_CHECKING:
    from bracket_cell.log.read.reader import Log, LogStream
    from bracket_cell.log.replay.compare import Comparison

DIFFERS = 1
OWN_PAGE = b'<meta name="generator" content="cell">'
SHOWN_NODES = 15
HALF_DIGIT_S = 0.005  # times are printed with two decimals

_ADDRESS = re.compile(r"([a-z0-9]{2,}):/+")


def fetched(paths: list[Path]) -> list[Path]:
    """Logs that stand at addresses such as s3://BUCKET/run.mcap, copied to this machine for as long as it is asked."""
    if folders := [path for path in paths if path.is_dir()]:
        raise LogError(folders[0], "is a folder; name logs in it")
    if not any(_ADDRESS.match(str(path)) for path in paths):
        return paths
    from bracket_cell.fleet.store import get

    folder = Path(mkdtemp(prefix="cell-logs-"))
    atexit.register(rmtree, folder, ignore_errors=True)
    found: list[Path] = []
    for path in paths:
        address = _ADDRESS.match(str(path))
        found += [path] if address is None else get(_ADDRESS.sub(r"\1://", str(path), count=1), folder)
    return found


def logs_argument(help: str) -> Any:
    """An argument of one log or more, in files or at addresses."""
    return typer.Argument(metavar="LOG...", help=help, callback=fetched)


LogArgument = Annotated[
    list[Path],
    logs_argument("Log of a run (MCAP), or parts of it; the first part stands for all. Or addresses (s3://...)."),
]


def a_time(value: float) -> float:
    """A time in a log: any number but nan; all that is printed as this number is up to it."""
    if math.isnan(value):
        raise typer.BadParameter("nan is not a time")
    return value + HALF_DIGIT_S


def _span(context: typer.Context, parameter: typer.CallbackParam, value: float) -> float:
    """A time of --from or --until; whichever comes second is compared with the first."""
    value = a_time(value) - (2 * HALF_DIGIT_S if parameter.name == "from_s" else 0.0)
    from_s, until_s = context.params.get("from_s"), context.params.get("until_s")
    if value < (value if from_s is None else from_s) or value > (value if until_s is None else until_s):
        raise typer.BadParameter("--from is later than --until")
    return value


AtOption = Annotated[
    float, typer.Option("--at", help="Time in a log in seconds; by default the last tick of the tree.", callback=a_time)
]
FromOption = Annotated[float, typer.Option("--from", help="From this time on, in seconds.", callback=_span)]
UntilOption = Annotated[float, typer.Option("--until", help="Up to this time, in seconds.", callback=_span)]


def read(paths: Sequence[Path]) -> Log:
    """A log; what it lacks is said on standard error."""
    from bracket_cell.log.read.reader import read_log

    log = read_log(paths[0] if len(paths) == 1 else paths)
    if log.unfinished:
        complain(f"{log.path}: {log.unfinished}")
    return log


def streamed(paths: Sequence[Path], from_s: float = 0.0, until_s: float = math.inf) -> LogStream:
    """A log file by file, however long it is: the parts that hold a span of the run's clock."""
    from bracket_cell.log.read.indexed import FOREVER_S, parts_within
    from bracket_cell.log.read.reader import LogStream, files_of

    files = files_of(paths[0]) if len(paths) == 1 else list(paths)
    return LogStream(parts_within(files, min(from_s, FOREVER_S), min(until_s, FOREVER_S)))


def tell_lack(paths: Sequence[Path], stream: LogStream) -> None:
    """What a log lacks that was read to its end, or the parts of it that were: on standard error."""
    from bracket_cell.log.read.reader import files_of

    files = files_of(paths[0]) if len(paths) == 1 else list(paths)
    for lack in (stream.unfinished,) if list(stream.parts) == files else stream.gaps:
        if lack:
            complain(f"{stream.path}: {lack}")


def spared(target: Path, sources: Iterable[Path], overwrite: bool | None = None) -> Path:
    """Where something is written: a new file, or a page of this program that stands there.

    Args:
        overwrite: somebody else's file, too; None where that cannot be asked for.

    Raises:
        InputError: that is one of the files that it is made of, or somebody else's file and may not be replaced.
    """
    if target.exists() and any(source.exists() and target.samefile(source) for source in sources):
        raise InputError(f"{target}: is also the input; choose another output file")
    if target.is_file() and not overwrite and not _own_page(target):
        or_else = "" if overwrite is None else ", or add --overwrite"
        raise InputError(f"{target}: exists already; choose another file{or_else}")
    return target


def _own_page(path: Path) -> bool:
    """Whether a file is a page that this program wrote."""
    try:
        with path.open("rb") as file:
            return OWN_PAGE in file.read(300)
    except OSError:
        return False


def beside(paths: Sequence[Path], suffix: str) -> Path:
    """A file beside a log, named as the log is; as the part is where a later part was named alone."""
    from bracket_cell.log.read.reader import files_of
    from bracket_cell.recording.parts import whole_path

    alone = len(paths) == 1 and files_of(paths[0]) == [paths[0]]
    return (paths[0] if alone else whole_path(paths[0])).with_suffix(suffix)


def tell_comparison(
    comparison: Comparison,
    unfinished: str,
    as_json: bool,
    names: tuple[str, str] = ("was", "now"),
    ticks_of_run: int | None = None,
    altered: bool = False,
    changed: Sequence[str] = (),
    causes: Sequence[str] = (),
) -> int:
    """Say how two runs compare; returns the exit status.

    Args:
        ticks_of_run: how many should have been compared; None where only a piece was asked for.
        altered: what the run saw was changed in its log.
        changed, causes: keys that were changed, and what was noted that explains the difference.
    """
    whole = ticks_of_run is None or comparison.ticks >= ticks_of_run
    if altered:
        complain("what the run saw was changed after the recording: the inputs do not match their digest")
    if as_json:
        tell_json(
            {**comparison.as_json(), "compared_of": ticks_of_run, "unfinished": unfinished, "inputs_altered": altered}
            | {"changed": list(changed), "why": list(causes)}
        )
    elif comparison.agrees:
        but = f" but for rounding in {comparison.rounded_ticks}, as on another processor" * (not comparison.identical)
        only = "" if whole else f", but only {comparison.ticks} of {ticks_of_run} could be compared"
        say(f"identical{but}: {counted(comparison.ticks, 'tick')}{only}")
    else:
        _tell_differences(comparison, names, changed, causes)
    return 0 if comparison.agrees and whole and not altered else DIFFERS


def _tell_differences(
    comparison: Comparison, names: tuple[str, str], changed: Sequence[str], causes: Sequence[str]
) -> None:
    """The first other command and why, what differs up to there, and in numbers what follows from it."""
    from bracket_cell.log.report.text import difference_lines

    first, leading = comparison.first, comparison.leading
    assert first is not None
    assert leading is not None
    say(f"{comparison.differing_ticks} of {comparison.ticks} ticks differ")
    say(f"first other {leading.aspect}:", *difference_lines(leading, names))
    for title, lines in (("changed:", changed[:SHOWN_NODES]), ("why:", causes)):
        if lines:
            say(title, *(f"      {line}" for line in lines))
    before = [
        difference
        for difference in comparison.first_by_aspect.values()
        if difference.tick <= leading.tick and difference is not leading
    ]
    if before:
        say("with it or before it:")
        say(*(line for difference in before for line in difference_lines(difference, names)))
    counts = ", ".join(f"{aspect} {count}" for aspect, count in comparison.ticks_by_aspect.most_common())
    nodes = [f"  {count:6d} {node}" for node, count in comparison.ticks_by_node.most_common(SHOWN_NODES)]
    say(f"all ticks that differ, with what follows from it: {counts}", *nodes)


def tell_entries(
    entries: Iterable[Mapping[str, Any]], as_json: bool, text: Callable[[Mapping[str, Any]], str], log: Path
) -> int:
    """Entries of a log one by one, in words or an object a line, and their number; none is said on standard error."""
    from bracket_cell.log.read.ticks import holding

    count = 0
    for count, entry in enumerate(entries, 1):  # noqa: B007 - counted to say where nothing was found
        with holding(log, f"what is there at {entry['time_s']} s"):
            say(json.dumps(entry) if as_json else text(entry))
    if not count:
        complain("nothing of that is in the log")
    return count


def tell_json(answer: Mapping[str, object]) -> None:
    """One line of JSON."""
    sys.stdout.write(json.dumps(answer) + "\n")


def say(*lines: str) -> None:
    """Lines on standard output."""
    sys.stdout.writelines(f"{printable(line)}\n" for line in lines)
