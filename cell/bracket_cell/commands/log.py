"""`cell log ...` and `cell report`: each command imports what it needs by itself."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from bracket_cell.commands.log_export import export_log
from bracket_cell.commands.log_terminal import (
    DIFFERS,
    AtOption,
    FromOption,
    LogArgument,
    UntilOption,
    beside,
    read,
    say,
    spared,
    streamed,
    tell_comparison,
    tell_entries,
    tell_json,
    tell_lack,
)
from bracket_cell.commands.options import OUT_HELP, HtmlOption, JsonOption, WithOption, always_loaded, user_files
from bracket_cell.commands.terminal import complain
from bracket_cell.production.book import NAME, Book, csv_lines
from bracket_ground.errors import CellError, InputError

LONGEST_VALUE = 200
log_app = typer.Typer(no_args_is_help=True, help="Search, compare and export logs.")


def report(
    log: LogArgument,
    out: Annotated[Path | None, typer.Option("--out", "-o", help=OUT_HELP)] = None,
    as_json: JsonOption = False,
) -> None:
    """Write one HTML page about a run, by default next to the log; of a run of hours it shows only the shift.

    Of a book of production, which `cell serve` keeps, it shows all shifts, and writes them as CSV beside it.
    """
    from bracket_cell.log.report.report import is_long, write_overview, write_report

    if len(log) == 1 and log[0].suffix == Path(NAME).suffix:
        _tell_page(*_production(log[0], spared(out or beside(log, ".html"), log)), as_json)
        return
    page, stream = spared(out or beside(log, ".html"), log), streamed(log)
    if is_long(stream.parts):
        size = write_overview(stream, page)
        tell_lack(log, stream)
    else:
        size = write_report(read(log), page)
    _tell_page(page, size, as_json)


def _production(path: Path, page: Path) -> tuple[Path, int]:
    """Write a book as a page, and as CSV beside it."""
    from bracket_cell.log.report.html_page import write_page
    from bracket_cell.log.report.report import production_html

    if not path.is_file():
        raise InputError(f"{path}: there is no such book")
    book = Book(path)
    size = write_page(production_html(book), page)
    write_page("".join(csv_lines(book.brackets())), page.with_suffix(".csv"))
    return page, size


def _tell_page(page: Path, size: int, as_json: bool) -> None:
    tell_json({"report": str(page), "bytes": size}) if as_json else say(f"{page}: {size / 1e6:.2f} MB")


@log_app.command()
def info(
    log: LogArgument,
    nodes: Annotated[
        bool, typer.Option("--nodes", help="List its nodes: how often each was ticked, how long it ran, how it ended.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Say what is in a log."""
    if nodes:
        _nodes(log, as_json)
        return
    from bracket_cell.log.report import query as question
    from bracket_cell.log.report.text import info_lines

    answer = question.info(stream := streamed(log))
    tell_lack(log, stream)
    if as_json:
        tell_json(answer)
    else:
        say(*info_lines(answer))


@log_app.command()
def ticks(
    log: LogArgument,
    from_s: FromOption = 0.0,
    until_s: UntilOption = float("inf"),
    everything: Annotated[bool, typer.Option("--all", help="Also ticks in which nothing was decided.")] = False,
    as_json: JsonOption = False,
) -> None:
    """List ticks with what was noted, commanded and shown; with --json one object a line."""
    from bracket_cell.log.report import query as question
    from bracket_cell.log.report.text import tick_lines

    stream = streamed(log, from_s, until_s)
    found = question.ticks(stream, from_s, until_s, everything)
    tell_entries(found, as_json, lambda tick: "\n".join(tick_lines(tick)), log[0])
    tell_lack(log, stream)


@log_app.command()
def why(log: LogArgument, at_s: AtOption = math.inf, as_json: JsonOption = False) -> None:
    """Say why the cell did what it did: the way through its tree, what was compared, what would have changed it."""
    from bracket_cell.log.replay.why import why_at
    from bracket_cell.log.report.text import why_lines

    tell_entries([why_at(log, at_s)], as_json, lambda reasons: "\n".join(why_lines(reasons)), log[0])


@log_app.command()
def query(
    log: LogArgument,
    node: Annotated[str | None, typer.Option(help="Part of a node's path.")] = None,
    status: Annotated[str | None, typer.Option(help="RUNNING, SUCCESS, FAILURE, SKIPPED or INVALID.")] = None,
    key: Annotated[str | None, typer.Option(help="Key that the entry has at any depth.")] = None,
    topic: Annotated[str | None, typer.Option(help="Part of the topic, like belief or command.")] = None,
    from_s: FromOption = 0.0,
    until_s: UntilOption = float("inf"),
    as_json: JsonOption = False,
) -> None:
    """Find status changes of nodes, or messages by topic and key; with --json one object a line."""
    from bracket_cell.log.report import query as question

    legal = ("RUNNING", "SUCCESS", "FAILURE", "SKIPPED", "INVALID")
    if status is not None and status not in legal:
        raise InputError(f"--status {status} is not a status; legal: {', '.join(legal)}")
    asked = question.Query(node, status, key, topic, from_s, until_s)
    from bracket_cell.log.report.text import entry_text

    stream = streamed(log, from_s, until_s)
    words, found = lambda entry: entry_text(entry, LONGEST_VALUE), question.query(stream, asked)
    if not tell_entries(found, as_json, words, log[0]):
        each = question.Query(node), question.Query(key=key), question.Query(topic=topic)
        for name, text, alone in zip(("node", "key", "topic"), (node, key, topic), each, strict=True):
            if text is not None and next(question.query(streamed(log), alone), None) is None:
                complain(
                    f"--{name} {text}: no {'tick changes such a node' if name == 'node' else f'JSON has such a {name}'}"
                )
    tell_lack(log, stream)


@log_app.command()
def rules(
    log: LogArgument,
    rules: Annotated[list[Path], typer.Option("--rules", help="File of rules (*.rules.yaml); may be repeated.")],
    own: WithOption = None,
    as_json: JsonOption = False,
) -> int:
    """Judge logs by rules; list each violation with tick and reason. Status 1 where there are any."""
    from bracket_cell.log.report.rules import judge, rule_lines

    files, beside = user_files(own)
    judged = [judge(path, rules, (*files, *always_loaded()), beside) for path in log]
    if as_json:
        for verdict in judged:
            tell_json(verdict.plain())
    else:
        say(*rule_lines(judged))
    return int(any(verdict.violations for verdict in judged))


def _nodes(log: list[Path], as_json: bool) -> None:
    from bracket_cell.log.report.node_statistics import node_statistics, statistics_lines

    found = node_statistics(stream := streamed(log))
    tell_lack(log, stream)
    if not any(node.ticks for node in found):
        complain("nothing of that is in the log")
    elif as_json:
        for node in found:
            tell_json(vars(node))
    else:
        say(*statistics_lines(found))


@log_app.command()
def diff(
    one: Annotated[Path, typer.Argument(metavar="A", help="Log.")],
    other: Annotated[Path, typer.Argument(metavar="B", help="Log to compare with.")],
    html: HtmlOption = None,
    as_json: JsonOption = False,
) -> int:
    """Compare what two logs saw and decided, tick by tick; status 1 if they differ.

    The page of --html shows the first difference, and both runs side by side.
    """
    from bracket_cell.log.report import query as question

    if html is not None:
        spared(html, (one, other))
    logs = read([one]), read([other])
    unfinished = "; ".join(log.unfinished for log in logs if log.unfinished)
    from bracket_cell.log.replay.explain import causes, changed_files

    names, found = (one.name, other.name) if one.name != other.name else ("A", "B"), question.diff(*logs)
    changed = [] if found.agrees else changed_files(*logs)
    why = causes(found, changed)
    if html is not None:
        from bracket_cell.log.report.diff_page import write_diff

        write_diff(*logs, found, names, html, why)
    keys = list(dict.fromkeys(map(str, changed)))
    return tell_comparison(found, unfinished, as_json, names, changed=keys, causes=why)


log_app.command("export")(export_log)


@log_app.command("list")
def list_runs(
    folder: Annotated[Path, typer.Argument(help="Folder with logs.")] = Path("runs"),
    where: Annotated[str | None, typer.Option(help='SQL condition, like "correct = false and seed < 10".')] = None,
    sql: Annotated[str | None, typer.Option(help="A whole SQL query of the table `runs`.")] = None,
    failures: Annotated[
        bool, typer.Option("--failures", help="Runs that failed: state, time, first cause, and the end.")
    ] = False,
    html: HtmlOption = None,
    statistics: Annotated[
        str | None, typer.Option(help="Shares and means with their 95 % intervals, by a column, like tree or goal.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    r"""List the runs of a folder, search them by SQL, or list those that failed; needs cell\[fleet].

    The page of --html goes with --failures, and has the seconds before each.
    """
    from bracket_cell.fleet import index
    from bracket_cell.fleet.index import summaries, summary_lines

    if not folder.is_dir():
        raise InputError(f"{folder}: is not a folder")
    if sum((sql is not None, failures, statistics is not None)) > 1:
        raise InputError("--sql, --failures and --statistics are different questions; ask one of them")
    if html is not None and not failures:
        raise InputError("--html goes with --failures")
    if where is not None and (sql is not None or failures):
        raise InputError("--where goes with the list of runs and with --statistics")
    for problem in index.refresh(folder):
        complain(f"left out: {problem}")
    columns = index.LISTED if statistics is None else "*"
    names, rows = index.ask(folder, sql or (index.FAILURES if failures else index.listing(where, columns)))
    if html is not None:
        from bracket_cell.fleet.night import write_night

        failed = [dict(zip(names, row, strict=True)) for row in rows]
        size = write_night(failed, spared(html, [Path(run["log"]) for run in failed]))
        say(f"{html}: {len(failed)} failed, {size / 1e6:.2f} MB")
    elif statistics is not None:
        for summary in summaries([dict(zip(names, row, strict=True)) for row in rows], statistics):
            tell_json(summary) if as_json else say(*summary_lines(summary, statistics))
    elif as_json:
        for row in rows:
            tell_json({name: _plain(value) for name, value in zip(names, row, strict=True)})
    else:
        _tell_table(names, rows)


def _plain(value: object) -> object:
    return value if value is None or isinstance(value, bool | int | float | str) else str(value)


def _tell_table(names: list[str], rows: list[tuple[object, ...]]) -> None:
    """Drawn on a terminal; elsewhere a line a row, with tabs between."""
    from rich.console import Console
    from rich.table import Table

    texts = [["" if value is None else str(value) for value in row] for row in rows]
    screen = Console(markup=False)
    if not screen.is_terminal:
        say(*("\t".join(" ".join(text.split()) for text in row) for row in [names, *texts]))
        return
    table = Table(*names)
    for row in texts:
        table.add_row(*row)
    screen.print(table)


@log_app.command("to-test")
def to_test(
    log: LogArgument,
    out: Annotated[Path, typer.Option("--out", "-o", help=OUT_HELP)] = Path("tests/cases"),
    name: Annotated[str | None, typer.Option(help="Name of the case; the log's by default.")] = None,
    until_s: UntilOption = float("inf"),
    as_json: JsonOption = False,
) -> int:
    """Turn a log into a regression case under 1 MB in a folder, which tests replay; status 1 if it differs already."""
    from bracket_cell.log.replay.case import check_case, write_case
    from bracket_cell.log.report.text import difference_lines

    case = out / f"{name or beside(log, '').name}.mcap"
    size = write_case(read(log), case, until_s)
    try:
        differing = check_case(case)
    except CellError:
        case.unlink()  # what cannot be replayed is no case
        raise
    if as_json:
        first = vars(differing[0]) if differing else None
        tell_json({"case": str(case), "bytes": size, "differences": len(differing), "first": first})
    else:
        say(
            f"{case}: {size} bytes",
            *(line for difference in differing[:1] for line in ("differs:", *difference_lines(difference))),
        )
    return DIFFERS if differing else 0
