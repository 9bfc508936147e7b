"""Fastenings: steps that are told by the action that is seen at their slots, or by the report of a tool."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from bracket_cell.trees.nodes.people import hole_on_bench_m
from bracket_cell.trees.nodes.services import CellNode
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.planning import AssemblyState
from btxml.engine.ports import InOutPort, InputPort
from btxml.engine.status import Status

TORQUE_SHARE = 0.95  # of what a step wants, from which a reported torque is enough: tools are calibrated to 5 %


class NoteFastenings(CellNode):
    """Note the fastenings of the product that the person has done, those whose parts were taken out no longer.

    One with a torque is told by its tool, as the order `fastened` with its name and the torque in Nm; another one by
    the action `screw`, seen at each of its slots since its turn came.
    """

    state = InOutPort(AssemblyState, "what is placed and fastened so far")
    near_m = InputPort(float, "how near a slot the fingertips are while they work there", default=0.06, least=0)
    persistent = ("_heard_s", "_worked_at", "_reports")

    _heard_s = -math.inf
    _worked_at: frozenset[tuple[str, str]] = frozenset()
    _reports: frozenset[str] = frozenset()

    def update(self) -> Status:
        product, state = self.tools.product, self.state.get()
        if not product.fastenings:
            return Status.SUCCESS
        goal = state.told_goal
        if goal is None and product.varies:
            goal = self.tools.infer(state, self.now.observation.operator.job).goal
        filled = product.accepted(goal) if goal in product.goals else product.positions
        at = {name: [slot for slot in fastening.at if slot in filled] for name, fastening in product.fastenings.items()}
        standing = [name for name in state.fastened if all(slot in state.placed for slot in at[name])]
        due = product.unfastened(filled, {*state.placed, *standing})
        self._worked_at = frozenset((name, slot) for name, slot in {*self._worked_at, *self._seen(due)} if name in due)
        self._reports = frozenset({*self._reports, *self._reported()}) if state.placed else frozenset()
        done = [name for name in due if name in self._reports or self._worked(name, at[name])]
        self._reports -= set(done)
        if (fastened := (*standing, *done)) != state.fastened:
            self.state.set(replace(state, fastened=fastened))
            self.tools.journal.note("belief", fastened=list(fastened))
        self.feedback_message = Message("{done} fastened", done=", ".join(fastened)) if fastened else ""
        return Status.SUCCESS

    def _worked(self, name: str, slots: list[str]) -> bool:
        """Whether the person was seen to screw at all of a fastening's slots, where that is enough."""
        wants_tool = self.tools.product.fastenings[name].torque_nm is not None
        return not wants_tool and all((name, slot) in self._worked_at for slot in slots)

    def _seen(self, due: list[str]) -> Iterator[tuple[str, str]]:
        """Fastening and slot, where the person is seen to screw at one whose turn it is."""
        view = self.now.observation.bench
        if view is None or view.hand is None or view.action.kind != "screw":
            return
        for name in due:
            for slot in self.tools.product.fastenings[name].at:
                away_m = math.dist(view.hand.fingertips_m, hole_on_bench_m(self.services, slot))
                if self.compare(away_m, "<=", self.near_m, slot):
                    yield name, slot

    def _reported(self) -> Iterator[str]:
        """Fastenings that a tool has reported with enough torque."""
        orders = [order for order in self.now.observation.operator.said if order.kind == "fastened"]
        for order in orders:
            if order.time_s > self._heard_s:
                name, _, torque = order.value.partition(" ")
                wanted = self.tools.product.fastenings[name].torque_nm
                if wanted is None or float(torque or 0) >= TORQUE_SHARE * wanted:
                    yield name
        self._heard_s = max((order.time_s for order in orders), default=self._heard_s)
