"""`cell serve`: a page that outlives runs."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bracket_cell.commands.options import (
    CONFIGURATION,
    PAGE_PORT,
    OpenOption,
    SetOption,
    WithOption,
    command_from,
    words_of,
)
from bracket_cell.commands.run import RealTimeOption, TreeArgument, chosen
from bracket_cell.commands.terminal import console
from bracket_cell.runs.options import RunOptions

if TYPE_CHECKING:
    from bracket_cell.configuration import Configuration
    from bracket_cell.production.book import Book
    from bracket_cell.serving.control import CellControl
    from bracket_cell.settings import OpcuaSettings
    from bracket_ground.interfaces.devices import Signals
    from bracket_ground.interfaces.product import Product

TYPED = ("configuration", "goal", "seed", "look", "brackets", "share", "work_orders")
SERVED = "served"  # folder beside the logs
BROWSERS = "browsers.jsonl"


@command_from(RunOptions, *TYPED, "page", configuration=CONFIGURATION, brackets=0)
def serve(
    options: RunOptions,
    tree: TreeArgument = None,
    real_time: RealTimeOption = None,
    entries: SetOption = None,
    own: WithOption = None,
    doors: OpenOption = None,
    begin: Annotated[bool, typer.Option("--begin", help="Begin a run at once.")] = False,
    assistant: Annotated[
        bool,
        typer.Option("--assistant", help="Serve no page, but an assistant that writes trees, over stdin and stdout."),
    ] = False,
) -> None:
    """Serve the page of a cell, and begin runs below it: with these options, each in a process of its own.

    The page outlives runs, and a run outlives the server: however that ends, the run goes on, and the next `cell serve`
    finds it. An assistant lists nodes, checks trees, simulates and explains, by the Model Context Protocol.
    """
    if assistant:
        from bracket_cell.serving.assistant import assistant_server

        assistant_server().run("stdio")
        return
    from bracket_cell.production.book import NAME, Book
    from bracket_cell.serving.certificate import fingerprint, with_certificate
    from bracket_cell.serving.control import CellControl
    from bracket_cell.serving.launcher import Launcher
    from bracket_cell.serving.paired import Paired
    from bracket_cell.serving.server import CellServer
    from bracket_cell.viewing.gate import Address

    asked = chosen(options, tree, real_time, entries, own, doors)
    configuration, product = _checked(asked)
    where, say = Address.parse(asked.page or str(PAGE_PORT), "--page"), console().print
    folder = configuration.log.folder / SERVED
    book = Book(folder.parent / NAME)
    words = [*words_of(options, TYPED), *_again(tree, real_time, {"--set": entries, "--with": own, "--open": doors})]
    launcher = Launcher(folder, book.path or Path(NAME), words)

    def news() -> None:
        say(f"code to operate: {paired.codes['operate']}, only to look: {paired.codes['look']}", highlight=False)

    paired = Paired(folder / BROWSERS, news)
    simulated = configuration.devices.simulated
    may = simulated if configuration.page.begin is None else configuration.page.begin
    more = _seeded(book, asked.seed) if simulated else list
    page = configuration.page if where.local else with_certificate(configuration.page, folder, where.host)
    titles = {goal: product.goal_title(goal) for goal in product.goals}
    control = CellControl(launcher, book, titles, more if may else None)
    server = CellServer(where, page, control, paired, product.name)
    say(f"the cell's page: {server.address}", highlight=False, soft_wrap=True)
    if page is not configuration.page and page.certificate is not None:
        say(f"its certificate is the cell's own; compare once: {fingerprint(page.certificate)}", highlight=False)
    news()
    with closing(server), _plant(configuration.plant.opcua, folder / "opcua", control), _bits(asked, control):
        if begin and not launcher.busy:
            launcher.begin("", None, more())
        _wait()
    if launcher.busy:
        say("the run goes on; `cell serve` finds it again", highlight=False)


def _checked(asked: RunOptions) -> tuple[Configuration, Product]:
    """What the runs will read; raises InputError where they could not begin."""
    from bracket_cell.configuration import load_configuration, load_product

    configuration = load_configuration(asked.configuration)
    asked.refuse_simulated(configuration)
    product = load_product(configuration, asked.configuration)
    asked.load(product, configuration)
    return configuration, product


def _again(tree: Path | None, real_time: float | None, repeated: Mapping[str, Iterable[str] | None]) -> list[str]:
    """What is typed in another form than a record has."""
    words = [] if tree is None else [str(tree)]
    words += [] if real_time is None else [f"--real-time={real_time:g}"]
    return words + [word for option, given in repeated.items() for each in given or () for word in (option, each)]


def _seeded(book: Book, seed: int) -> Callable[[], list[str]]:
    """Another seed for each simulated run."""
    return lambda: ["--seed", str(seed + len(book.runs()))]


@contextmanager
def _plant(settings: OpcuaSettings | None, folder: Path, control: CellControl) -> Iterator[None]:
    """OPC UA, where it is configured."""
    if settings is None:
        yield
        return
    from bracket_cell.plant.opcua_server import OpcuaServer

    say = partial(console().print, highlight=False)
    with closing(OpcuaServer(settings, folder, control, say)) as server:
        say(f"OPC UA: {server.address}")
        yield


@contextmanager
def _bits(asked: RunOptions, control: CellControl) -> Iterator[None]:
    """Signals between runs, where one of them begins a run."""
    from bracket_cell.configuration import load_configuration, load_product

    configuration = load_configuration(asked.configuration)
    settings = configuration.plant.bits
    if not settings.begin or configuration.devices.signals is None:
        yield
        return
    from bracket_cell.plant.bits import WaitingBits
    from bracket_cell.wiring.devices import opened_alone

    product = load_product(configuration, asked.configuration)

    @contextmanager
    def signals() -> Iterator[Signals]:
        with opened_alone(configuration, product, "signals") as (opened, _):
            yield opened

    with closing(WaitingBits(settings, signals, control, partial(console().print, highlight=False))):
        yield


def _wait() -> None:
    """Until somebody ends the program."""
    over = threading.Event()
    for name in (signal.SIGTERM, signal.SIGINT):
        signal.signal(name, lambda *_: over.set())
    over.wait()
