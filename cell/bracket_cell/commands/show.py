"""`cell show`: trees as they stand in a file, as they ran in a log, or as they run now."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated
from xml.etree import ElementTree

import typer

from bracket_cell.commands.log_terminal import AtOption, spared
from bracket_cell.commands.options import HtmlOption, OverwriteOption, WithOption, always_loaded, user_files
from bracket_cell.commands.terminal import complain, console, printable
from bracket_ground.errors import InputError, LogError

if TYPE_CHECKING:
    from bracket_cell.log.read.reader import Log, LoggedTick, LogStream
    from btxml.views.groot2 import StatusBoard

LOGS = (".mcap",)


def show(
    source: Annotated[
        Path | None,
        typer.Argument(metavar="FILE", help="Tree file, or log of a run (MCAP); leave it out with --running."),
    ] = None,
    product: Annotated[
        Path | None, typer.Argument(metavar="[PRODUCT]", help="After the word product: its file, or a configuration.")
    ] = None,
    at_s: AtOption = math.inf,
    running: Annotated[
        int | None,
        typer.Option(
            "--running",
            metavar="[PORT]",
            min=1,
            max=65534,
            help="Watch a `cell run --open monitor` of this machine; once, where no terminal shows it or it is drawn.",
        ),
    ] = None,
    svg: Annotated[Path | None, typer.Option(help="Draw the trees into this SVG file.")] = None,
    png: Annotated[Path | None, typer.Option(help="Draw the trees into this PNG file.")] = None,
    html: HtmlOption = None,
    own: WithOption = None,
    overwrite: OverwriteOption = False,
) -> None:
    """Print or draw the tree of a file or a log, or watch that of a run: what every node does, and why.

    The page of --html browses the tree; of a log with a time line of all its ticks.
    `show product FILE` prints or draws a product: its goals, their steps, and what comes before what. Keys of a run
    that is watched: b and a name set a breakpoint, p pauses, s steps, t shows the whole tree, arrows scroll, q leaves.
    """
    if product is not None:
        if source != Path("product"):
            raise InputError(f"one FILE is shown, or a product: cell show product {product}")
        _show_product(product, svg, png, overwrite)
        return
    if (source is None) != (running is not None):
        raise InputError("name a tree file or a log, or say --running")
    if html is not None and (running is not None or not math.isinf(at_s)):
        raise InputError("--html goes with a tree file or a whole log, without --running and --at")
    if source is not None and source.suffix in (".yaml", ".yml"):
        raise InputError(f"{source}: no tree and no log; `cell show product FILE` shows a product")
    of_log = source is not None and source.suffix in LOGS
    if not of_log and not math.isinf(at_s):
        raise InputError("--at goes with a log")
    for drawing in filter(None, (svg, png, html)):
        spared(drawing, filter(None, [source]), overwrite)
    nodes, trees = user_files(own)
    nodes = (*nodes, *always_loaded())
    if source is None:
        _show_running(running or 0, svg, png)
        return
    if html is not None:
        _write_page(source, of_log, html, nodes, trees)
    if html is not None and svg is None and png is None:
        return
    if of_log:
        _tell_or_draw(_logged(source, at_s, nodes), svg, png)
    else:
        _show_file(source, svg, png, nodes, trees)


def _show_running(port: int, svg: Path | None, png: Path | None) -> None:
    """Watch a run on a terminal; where there is none, or a drawing is asked for, its tree as it is now."""
    from bracket_cell.viewing.live_view import MonitorClient, live_view

    if svg is None and png is None and (screen := console()).is_terminal:
        live_view(port, screen)
        return
    client = MonitorClient(port)
    try:
        shown = TreeAt(client.tree(), client.statuses(), client.said(), math.nan)
    finally:
        client.close()
    _tell_or_draw(shown, svg, png)


def _tell_or_draw(shown: TreeAt, svg: Path | None, png: Path | None) -> None:
    if svg is None and png is None:
        _tell(shown)
        return
    from btxml.views.picture import running_picture

    _draw(running_picture(shown.xml, shown.statuses, shown.said), svg, png)


def _show_file(
    file: Path, svg: Path | None, png: Path | None, own_nodes: Iterable[str], beside: Iterable[Path]
) -> None:
    from bracket_cell.trees.node_library import node_registry

    registry = node_registry(more=own_nodes)
    if svg is None and png is None:
        from btxml.views.show import show_file

        sys.stdout.write(show_file(file, registry, beside))
    else:
        from btxml.views.picture import picture

        _draw(picture(file, registry, beside), svg, png)


def _write_page(source: Path, of_log: bool, page: Path, own_nodes: Iterable[str], beside: Iterable[Path]) -> None:
    from bracket_cell.log.report.tree_page import write_file_page, write_log_page
    from bracket_cell.trees.node_library import node_registry

    if of_log:
        from bracket_cell.commands.log_terminal import read

        size = write_log_page(read([source]), own_nodes, beside, page)
    else:
        size = write_file_page(source, node_registry(more=own_nodes), beside, page)
    sys.stdout.write(f"{page}: {size / 1e6:.1f} MB\n")


def _show_product(file: Path, svg: Path | None, png: Path | None, overwrite: bool) -> None:
    from bracket_cell.configuration import load_configuration
    from bracket_cell.viewing.product_picture import product_picture, product_text
    from bracket_ground.files.yaml_file import has_key, load_yaml
    from bracket_ground.interfaces.product import Product

    shown = load_yaml(load_configuration(file).product if has_key(file, "bench") else file, Product)
    if svg is None and png is None:
        sys.stdout.write(product_text(shown))
        return
    for drawing in filter(None, (svg, png)):
        spared(drawing, [file], overwrite)
    _draw(product_picture(shown), svg, png)


def _logged(log: Path, at_s: float, own_nodes: Iterable[str]) -> TreeAt:
    from bracket_cell.commands.log_terminal import streamed, tell_lack

    stream = streamed([log])
    shown = tree_at(stream, at_s, own_nodes)
    tell_lack([log], stream)
    if shown.last and at_s > shown.time_s:
        complain(f"{log}: ends at {shown.time_s:.2f} s; this is its last tick")
    return shown


def _tell(shown: TreeAt) -> None:
    from bracket_cell.viewing.tree_lines import lines_of

    when = "" if math.isnan(shown.time_s) else f" at {shown.time_s:.2f} s"
    name = next(shown.xml.iter("BehaviorTree")).get("ID", "")
    lines = [line.text().plain for line in lines_of(shown.xml, shown.statuses, shown.said)]
    sys.stdout.writelines(f"{printable(line)}\n" for line in [f"{name}{when}", *lines])


def _draw(drawing: str, svg: Path | None, png: Path | None) -> None:
    from btxml.views.picture import to_png

    if svg is not None:
        write(svg, drawing.encode())
    if png is not None:
        write(png, to_png(drawing))


def write(path: Path, content: bytes) -> None:
    """Write a file that the person asked for.

    Raises:
        InputError: it cannot be written.
    """
    try:
        path.write_bytes(content)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None


@dataclass(frozen=True)
class TreeAt:
    """A tree and what its nodes did.

    Attributes:
        xml: the tree with SubTrees and uids, in Groot2's form.
        statuses: numbers in Groot2's protocol, by uid.
        said: what nodes said last, by uid.
        time_s: of the tick that is shown.
        last: a time was asked for, and this is the last tick of the log.
    """

    xml: ElementTree.Element
    statuses: dict[int, int]
    said: dict[int, str]
    time_s: float
    last: bool = False


def tree_at(log: Log | LogStream, at_s: float = math.inf, more: Iterable[str] = ()) -> TreeAt:
    """After the last tick up to a time [s]; by default the last tick in which the tree still ran.

    Raises:
        LogError: the log holds no tree, or no tick so early.
        InputError: this version cannot load the tree.
    """
    from bracket_cell.log.replay.logged_tree import logged_tree
    from bracket_cell.trees.node_library import node_registry
    from btxml.views.groot2 import StatusBoard, tree_xml

    ticks = (tick for piece in log for tick in piece.ticks)
    now = next(ticks, None)
    if now is None or now.time_s > at_s:
        raise LogError(log.path, "holds no tick" + ("" if math.isinf(at_s) and at_s > 0 else f" up to {at_s:g} s"))
    tree = logged_tree(log, more)
    board, said = StatusBoard(len(tree.nodes)), dict[int, str]()
    _take(now, board, said)
    following = next(ticks, None)
    while following is not None and following.time_s <= at_s:
        after = next(ticks, None)
        if math.isinf(at_s) and after is None and following.status != "RUNNING":
            break  # the last one ends the tree, and with it every node
        now, following = following, after
        _take(now, board, said)
    xml = ElementTree.fromstring(tree_xml(tree, node_registry(more=more)))
    over = following is None and not math.isinf(at_s)
    return TreeAt(xml, board.codes(), said, now.time_s, over)


def _take(tick: LoggedTick, board: StatusBoard, said: dict[int, str]) -> None:
    board.update(tick.changes, tick.time_s)
    said |= {change.uid: change.feedback for change in tick.changes}
