"""Who watches a run from outside: a viewer of the log's channels, a monitor of the tree, the operator's page."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from cell.files.files import shipped
from cell.interfaces.operator import OperatorOrder
from cell.recording.recorder import McapRecorder
from cell.runs.heading import tree_texts
from cell.runs.options import Files, RunOptions
from cell.watching.observer import Observer
from trees.engine.tree import Tree
from trees.node_library import node_registry

if TYPE_CHECKING:
    from cell.viewing.live_server import LiveServer
    from cell.viewing.monitor import Monitor
    from cell.viewing.page.page import OperatorPage

LAYOUT = shipped("config", "foxglove_layout.json")


@dataclass(frozen=True)
class Viewers:
    """As many of them as were asked for."""

    recorder: McapRecorder
    live: LiveServer | None
    monitor: Monitor | None
    page: OperatorPage | None

    @property
    def observers(self) -> tuple[Observer, ...]:
        """They see every tick."""
        return tuple(one for one in (self.live, self.monitor, self.page) if one is not None)

    @property
    def addresses(self) -> list[str]:
        """Where they are found, a line each."""
        live = [] if self.live is None else [f"live: ws://127.0.0.1:{self.live.port} (layout: {LAYOUT})"]
        return live if self.page is None else [*live, f"the operator's page: {self.page.address}"]

    def edited(self, tree: Tree, time_s: float) -> None:
        """An edited tree took over: the log keeps its text, monitor and page show it."""
        self.recorder.edited(tree_texts(tree), time_s)
        for viewer in (self.monitor, self.page):
            if viewer is not None:
                viewer.watch(tree)


def open_viewers(
    options: RunOptions,
    files: Files,
    recorder: McapRecorder,
    put: Callable[[OperatorOrder], None],
    now_s: Callable[[], float],
    stack: ExitStack,
) -> Viewers:
    """Open those that were asked for.

    Args:
        put: takes the orders of the page.
        stack: ends them where the run breaks off.

    Raises:
        InputError: a port is taken.
    """
    live, monitor, page = None, None, None
    if options.live_port is not None:
        from cell.viewing.live_server import LiveServer

        live = LiveServer(recorder.context, recorder.scene, options.live_port)
        stack.callback(live.abandon)
    if options.monitor_port is not None:
        from cell.viewing.monitor import Monitor

        def hooked(kind: str, body: Any) -> None:
            recorder.hooked(kind, body, now_s())

        registry = node_registry(more=(*options.nodes, *files.configuration.nodes))
        monitor = Monitor(files.tree, registry, options.monitor_port, options.monitor_hooks, hooked)
        stack.callback(monitor.abandon)
    if options.page_port is not None:
        from cell.viewing.page.page import OperatorPage

        told = {"product": files.product.name, "tree": options.tree.name, "seed": str(options.seed)}
        told |= {"unsafe": "; ".join(files.unsafe)} if files.unsafe else {}
        page = OperatorPage(files.product, files.configuration.bench, told, files.tree, put, options.page_port)
        stack.callback(page.abandon)
    return Viewers(recorder, live, monitor, page)
