"""Who watches a run from outside: a viewer of the log's channels, a monitor of the tree, the operator's page."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bracket_cell.production.bookkeeper import Bookkeeper
from bracket_cell.production.samples import Samples
from bracket_cell.recording.recorder import McapRecorder
from bracket_cell.recording.scene import CellModel
from bracket_cell.runs.heading import tree_texts
from bracket_cell.runs.options import Files, RunOptions
from bracket_cell.trees.node_library import node_registry
from bracket_cell.viewing.gate import Address
from bracket_cell.watching.observer import Observer
from bracket_ground.files.files import shipped
from bracket_ground.interfaces.operator import OperatorOrder
from btxml.engine.tree import Tree

if TYPE_CHECKING:
    from bracket_cell.plant.ros_topics import RosTopics
    from bracket_cell.plant.sparkplug import SparkplugNode
    from bracket_cell.viewing.live_server import LiveServer
    from bracket_cell.viewing.monitor import Monitor
    from bracket_cell.viewing.page.page import OperatorPage

LAYOUT = shipped("bracket_cell.config", "foxglove_layout.json")


@dataclass(frozen=True)
class Viewers:
    """As many of them as were asked for.

    Attributes:
        opcua: where a configured server of OPC UA would listen; empty for none.
    """

    recorder: McapRecorder
    live: LiveServer | None
    monitor: Monitor | None
    page: OperatorPage | None
    mqtt: SparkplugNode | None
    ros: RosTopics | None
    opcua: str = ""

    @property
    def observers(self) -> tuple[Observer, ...]:
        """They see every tick."""
        viewers = (self.live, self.monitor, self.page, self.mqtt, self.ros)
        return tuple(viewer for viewer in viewers if viewer is not None)

    @property
    def addresses(self) -> list[str]:
        """Where they are found, a line each."""
        urls = [] if self.live is None else [f"live: ws://127.0.0.1:{self.live.port} (layout: {LAYOUT})"]
        if self.page is not None and self.page.served:
            urls.append("the operator's page is that of `cell serve`")
        elif self.page is not None:
            urls.append(f"the operator's page: {self.page.address}")
            urls += [f"only to look: {self.page.address_of('look')}"] * (not self.page.local)
            urls += ["without page.certificate others on the network can read these addresses"] * self.page.in_clear
        urls += [] if self.mqtt is None else [f"MQTT: {self.mqtt.address}"]
        urls += [] if self.ros is None else [self.ros.address]
        alone = bool(self.opcua) and (self.page is None or not self.page.served)
        return (
            [*urls, f"plant.opcua: nothing listens at {self.opcua}, as `cell serve` alone serves it"] if alone else urls
        )

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
    say: Callable[[str], None],
    now_s: Callable[[], float],
    stack: ExitStack,
    model: CellModel,
    keeper: Bookkeeper,
) -> Viewers:
    """Open those that were asked for.

    Args:
        put: takes the orders of the page.
        say: is told of systems that are lost.
        stack: ends them where the run breaks off.
        keeper: has the numbers of the work.

    Raises:
        InputError: a port is taken, or an extra is missing.
    """
    live, monitor, page, mqtt, ros = None, None, None, None, None
    if options.live_port is not None:
        from bracket_cell.viewing.live_server import LiveServer

        live = LiveServer(recorder.context, recorder.scene, options.live_port)
        stack.callback(live.abandon)
    if options.monitor_port is not None:
        from bracket_cell.viewing.monitor import Monitor

        def hooked(kind: str, body: Any) -> None:
            recorder.hooked(kind, body, now_s())

        registry = node_registry(more=(*options.nodes, *files.configuration.nodes))
        monitor = Monitor(files.tree, registry, options.monitor_port, options.monitor_hooks, hooked)
        stack.callback(monitor.abandon)
    if options.page is not None:
        from bracket_cell.viewing.page.page import OperatorPage

        where, settings, facts = Address.parse(options.page, "--page"), files.configuration.page, _told(options, files)
        page = OperatorPage(model, facts, files.tree, put, where, settings, keeper, options.slower)
        stack.callback(page.abandon)
    if (broker := files.configuration.plant.mqtt) is not None:
        from bracket_cell.plant.sparkplug import SparkplugNode

        mqtt = SparkplugNode(Samples(keeper.book, keeper), broker, say)
        stack.callback(mqtt.abandon)
    if (topics := files.configuration.plant.ros2) is not None:
        from bracket_cell.plant.ros_topics import RosTopics

        def why() -> str:
            return str(recorder.why().get("text", ""))

        assert recorder.scene is not None  # it has the model
        ros = RosTopics(topics, model.motion, recorder.scene, why)
    opcua = files.configuration.plant.opcua
    return Viewers(recorder, live, monitor, page, mqtt, ros, "" if opcua is None else opcua.at)


def _told(options: RunOptions, files: Files) -> dict[str, str]:
    """What the page says of the run, by name."""
    fields = {"product": files.product.name, "tree": options.tree.name, "seed": str(options.seed)}
    fields |= {"safety": files.safety.short} | ({"unsafe": "; ".join(files.unsafe)} if files.unsafe else {})
    return fields | ({"shift": "yes"} if options.brackets is not None else {})
