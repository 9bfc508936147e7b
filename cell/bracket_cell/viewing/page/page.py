"""The observer behind the operator's page: follows the run and publishes its state while somebody looks."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from bracket_cell.production.bookkeeper import Bookkeeper
from bracket_cell.production.samples import Samples
from bracket_cell.recording.scene import CellModel
from bracket_cell.settings import PageSettings
from bracket_cell.viewing.gate import Address
from bracket_cell.viewing.page.live_tree import LiveTree
from bracket_cell.viewing.page.scene import scene_of
from bracket_cell.viewing.page.server import PageServer
from bracket_cell.viewing.page.state import PageState
from bracket_cell.viewing.page.web import Role
from bracket_cell.watching.observer import Level, Observer, Outcome, TickRecord
from bracket_ground.interfaces.frame import Frame, PendingFrame
from bracket_ground.interfaces.operator import OperatorOrder
from btxml.engine.tree import Tree

KEPT_FRAMES = 8  # that detectors have not answered yet
EVERY_S = 0.1  # of wall time, between two states
SILENT_S = 2.0  # without a state, after which a page shows no old one as new


class OperatorPage(Observer):
    """An observer that serves a page (`cell run --page`).

    Args:
        heading: what is shown of the run, by name.
        obey: takes an operator's order.
        keeper: of the run's production.
        slower: times slower than the wall that the run goes.

    Raises:
        InputError: the port is taken, or a TLS file cannot be used.
    """

    def __init__(
        self,
        model: CellModel,
        heading: Mapping[str, str],
        tree: Tree,
        obey: Callable[[OperatorOrder], None],
        where: Address,
        settings: PageSettings,
        keeper: Bookkeeper,
        slower: float = 1.0,
    ) -> None:
        self._silent_s = SILENT_S * slower
        self._state, self._live = PageState(model, heading, tree, keeper), LiveTree(tree)
        samples = Samples(keeper.book, keeper)
        self._server = PageServer(where, obey, settings, scene_of(model), samples, self._still(), self._live.since)
        self._published_s = float("-inf")
        self._last: TickRecord | None = None
        self._frames: deque[Frame] = deque(maxlen=KEPT_FRAMES)

    @property
    def address(self) -> str:
        """Where an operator opens it."""
        return self._server.address

    def address_of(self, role: Role) -> str:
        """Where somebody opens it who operates, or only looks."""
        return self._server.address_of(role)

    @property
    def served(self) -> bool:
        """Another process serves it, and asks at a socket."""
        return self._server.where.path is not None

    @property
    def local(self) -> bool:
        """Only browsers of this machine reach it."""
        return self._server.where.local

    @property
    def in_clear(self) -> bool:
        """It goes over a network, and not by TLS."""
        return not self.local and self._server.scheme == "http"

    @property
    def port(self) -> int:
        """Where it listens."""
        return self._server.port

    def watch(self, tree: Tree) -> None:
        """An edited tree has taken over."""
        self._state.watch(tree)
        self._live.watch(tree)
        self._server.still(self._still())

    def _still(self) -> dict[str, Any]:
        return {**self._state.still(), "silent_s": self._silent_s}

    def frame(self, frame: Frame) -> None:
        if frame.camera == "overhead":
            self._frames.append(frame)

    def tick(self, record: TickRecord) -> None:
        self._state.take(record)
        self._live.take(record)
        self._last = record
        now_s = time.monotonic()
        if now_s - self._published_s >= EVERY_S and (self._server.watched or self._published_s < 0):
            self._published_s = now_s
            self._show_frame(record)
            self._server.still(self._still())
            self._server.publish(self._state.now(record))

    def _show_frame(self, record: TickRecord) -> None:
        """The image in which the hand was found; where nothing was found for long, the newest."""
        view = record.observation.bench
        found = [frame for frame in self._frames if view is not None and frame.sequence == view.sequence]
        ready = [frame for frame in self._frames if not isinstance(frame, PendingFrame) or frame.ready]
        if not found and view is not None and self._frames and view.sequence > self._frames[0].sequence:
            return
        for frame in (found or ready)[-1:]:
            self._server.show(frame.sequence, frame.image)

    def message(self, time_s: float, level: Level, text: str) -> None:
        self._state.say(time_s, level, text)

    def close(self, outcome: Outcome) -> None:
        self._state.end(outcome)
        if self._last is not None:
            self._server.publish(self._state.now(self._last))
        self._server.close()

    def abandon(self) -> None:
        """Stop serving; harmless when repeated."""
        self._server.close()
