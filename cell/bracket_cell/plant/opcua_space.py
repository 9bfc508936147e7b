"""What a client of OPC UA finds of a cell: numbers, PackML's tags and commands, work orders, alarms, and brackets."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable, Mapping, Sequence
from contextlib import suppress
from contextvars import ContextVar
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

from bracket_cell.plant.packml import PRODUCTION, State, state_of
from bracket_cell.production.book import BracketRow
from bracket_cell.production.samples import Sample
from bracket_cell.viewing.advice import ADVICE
from bracket_ground.errors import InputError
from bracket_ground.interfaces.operator import OrderKind

if TYPE_CHECKING:
    from asyncua.common.node import Node
    from asyncua.server.server import Server

NAMESPACE = "urn:bracket-cell"
BRACKETS_N = 50  # of the book's last ones that are looked through for new events
SEVERITY, SEVERITY_OVER = 700, 100  # of what holds the cell, and when it is gone: OPC 10000-5, 6.4.2, high and low
COMMANDS: Mapping[str, tuple[OrderKind, str]] = {
    "Hold": ("pause", "now"),
    "Unhold": ("resume", ""),
    "Clear": ("acknowledge", ""),
    "Complete": ("finish", ""),
    "Stop": ("stop", ""),
}  # ISA-TR88.00.02, 4.3
AXIS, ALARM = "cell_axis_position", "cell_alarm"  # samples that stand elsewhere than under Numbers
NO_ANSWER = "the run does not answer"
CALLER: ContextVar[str] = ContextVar("caller", default="")  # the name of the client whose request is worked on


class Control(Protocol):
    """The cell that is served: what it is, and what may be ordered of it."""

    @property
    def busy(self) -> bool:
        """A run goes on, begins or ends."""

    @property
    def ended(self) -> str | None:
        """How the last run ended, "" where it was killed; None where there was none."""

    async def samples(self) -> Sequence[Sample]:
        """The numbers as they are now.

        Raises:
            TimeoutError: a run goes on and does not answer.
        """

    async def order(self, order: Mapping[str, Any]) -> None:
        """Give an order, as the page does.

        Raises:
            InputError: it is refused.
        """

    def begin(self, operator: str, *, resume: bool) -> None:
        """Begin a run.

        Raises:
            InputError: it is refused.
        """

    def brackets(self, last: int) -> Sequence[BracketRow]:
        """The newest of the book, in order."""

    def orders(self) -> Sequence[Mapping[str, Any]]:
        """Work orders, with id, variant, amount and due."""


class CellSpace:
    """The address space under Objects/Cell; numbers of a run that does not answer are bad, not old."""

    def __init__(self, server: Server, control: Control) -> None:
        self._server, self._control = server, control
        self._nodes: dict[str, Node] = {}
        self._good: set[str] = set()
        self._alarms: dict[str, Any] = {}
        self._active: set[str] = set()
        self._told: set[tuple[int, int]] | None = None

    async def make(self) -> None:
        """Everything that is always there."""
        self._space = space = await self._server.register_namespace(NAMESPACE)
        cell = self._cell = await self._server.nodes.objects.add_object(space, "Cell")
        self._numbers = await cell.add_object(space, "Numbers")
        self._axes = await (await cell.add_object(space, "MotionDevices")).add_object(space, "Axes")
        self._conditions = await cell.add_object(space, "Alarms")
        status = await cell.add_object(space, "Status")
        self._state = await status.add_variable(f"ns={space};s=Status.StateCurrent", "StateCurrent", _dint(State.IDLE))
        self._name = await status.add_variable(f"ns={space};s=Status.State", "State", State.IDLE.name)
        await status.add_variable(f"ns={space};s=Status.UnitModeCurrent", "UnitModeCurrent", _dint(PRODUCTION))
        await self._make_methods()
        await self._make_events()

    async def renew(self) -> None:
        """Everything as it is now."""
        from asyncua import ua

        try:
            samples: Sequence[Sample] = await self._control.samples()
        except TimeoutError:
            silent = ua.DataValue(StatusCode=_status("BadNoCommunication"))
            for node in (self._state, self._name, *(self._nodes[name] for name in self._good)):
                await node.write_value(silent)
            self._good.clear()
            return
        state = state_of(samples, busy=self._control.busy, ended=self._control.ended)
        await self._state.write_value(_dint(state))
        await self._name.write_value(state.name)
        await self._show(samples)
        await self._alarm({labels["signal"] for name, labels, _ in samples if name == ALARM})
        await self._tell_brackets()

    async def _show(self, samples: Sequence[Sample]) -> None:
        from asyncua import ua

        shown = {".".join((name, *labels.values())): (name, value) for name, labels, value in samples if name != ALARM}
        for full, (name, value) in shown.items():
            if full not in self._nodes:
                above, browsed = (self._axes, full.partition(".")[2]) if name == AXIS else (self._numbers, full)
                self._nodes[full] = await above.add_variable(f"ns={self._space};s={full}", browsed, float(value))
            await self._nodes[full].write_value(float(value))
        for gone in self._good - shown.keys():
            await self._nodes[gone].write_value(ua.DataValue(StatusCode=_status("BadNoData")))
        self._good = set(shown)

    async def _make_methods(self) -> None:
        """PackML's commands, and work orders."""
        from asyncua import ua

        async def begin(resume: bool) -> None:
            await asyncio.to_thread(self._control.begin, CALLER.get(), resume=resume)

        async def job(id: str, variant: str, amount: int, due: str) -> None:
            await self._job({"id": id, "variant": variant, "amount": amount, "due": due})

        async def cancel(id: str) -> None:
            known = next((order for order in self._control.orders() if order["id"] == id), None)
            if known is None:
                raise InputError(f"there is no work order {id!r}")
            await self._job({**{key: known[key] for key in ("id", "variant", "amount", "due")}, "cancelled": True})

        text, number, flag = ua.VariantType.String, ua.VariantType.UInt32, ua.VariantType.Boolean
        await self._method("Start", begin, {"Resume": flag})
        await self._method("Order", job, {"Id": text, "Variant": text, "Amount": number, "Due": text})
        await self._method("Cancel", cancel, {"Id": text})
        for name, (kind, value) in COMMANDS.items():
            await self._method(name, partial(self._control.order, {"kind": kind, "value": value}), {})

    async def _job(self, order: Mapping[str, Any]) -> None:
        given = {key: value for key, value in order.items() if value != ""}
        await self._control.order({"kind": "job", "value": json.dumps(given)})

    async def _method(self, name: str, does: Callable[..., Awaitable[None]], inputs: Mapping[str, Any]) -> None:
        """A method that says whether it was accepted, and if not, why."""
        from asyncua import ua

        async def called(_: Any, *given: Any) -> Any:
            if [value.VariantType for value in given] != list(inputs.values()) or any(
                value.is_array for value in given
            ):
                return _status("BadInvalidArgument")
            try:
                await does(*("" if value.Value is None else value.Value for value in given))
            except (InputError, TimeoutError) as error:
                return [ua.Variant(False), ua.Variant(str(error) or NO_ANSWER)]
            return [ua.Variant(True), ua.Variant("")]

        typed = [_argument(*item) for item in inputs.items()]
        answer = [_argument("Accepted", ua.VariantType.Boolean), _argument("Answer", ua.VariantType.String)]
        node = f"ns={self._space};s={name}"
        await self._cell.add_method(node, ua.QualifiedName(name, self._space), called, typed, answer)

    async def _make_events(self) -> None:
        """Alarms can be acknowledged by the standard's own method; a bracket that ended is an event."""
        from asyncua import ua
        from asyncua.ua.object_ids import ObjectIds

        async def acknowledged(*_: Any) -> Any:
            try:
                await self._control.order({"kind": "acknowledge"})
            except (InputError, TimeoutError):
                return _status("BadInvalidState")
            return []

        method = ObjectIds.AcknowledgeableConditionType_Acknowledge
        self._server.link_method(self._server.get_node(ua.NodeId(ua.Int32(method))), acknowledged)
        text, number, flag = ua.VariantType.String, ua.VariantType.UInt32, ua.VariantType.Boolean
        fields = [("Run", number), ("Number", number), ("Variant", text), ("OrderId", text), ("Finished", flag)]
        fields += [("Seconds", ua.VariantType.Double), ("ByRobot", number), ("ByPerson", number)]
        kind = await self._server.create_custom_event_type(self._space, "BracketEventType", properties=fields)
        self._bracket = await self._server.get_event_generator(kind)

    async def _tell_brackets(self) -> None:
        """Brackets that ended since the server began."""
        rows = await asyncio.to_thread(self._control.brackets, BRACKETS_N)
        ended = {(row.run, row.number): row for row in rows if row.finished is not None}
        for row in () if self._told is None else [row for key, row in ended.items() if key not in self._told]:
            event = self._bracket.event
            event.Run, event.Number, event.Variant, event.OrderId = row.run, row.number, row.variant, row.order
            event.Finished, event.Seconds = bool(row.finished), row.length_s
            event.ByRobot, event.ByPerson = row.robot, row.person
            await self._bracket.trigger(row.end_utc, f"bracket {row.number} of run {row.run} ended")
        self._told = set(ended)

    async def _alarm(self, active: set[str]) -> None:
        """One condition for each signal that holds the cell, or did."""
        for signal in active ^ self._active:
            if signal not in self._alarms:
                self._alarms[signal] = await self._made(signal)
            await self._change(self._alarms[signal], signal, active=signal in active)
        self._active = active

    async def _made(self, signal: str) -> Any:
        from asyncua.ua.object_ids import ObjectIds

        kind = ObjectIds.OffNormalAlarmType
        condition = await self._conditions.add_object(self._space, signal, kind, instantiate_optional=False)
        generator = await self._server.get_event_generator(kind)
        event = generator.event
        event.NodeId, event.SourceNode, event.SourceName = condition.nodeid, self._cell.nodeid, "Cell"
        event.ConditionName = signal
        return generator

    async def _change(self, generator: Any, signal: str, *, active: bool) -> None:
        """It is there, or it is over: then nobody needs to acknowledge it any more."""
        from asyncua import ua

        event = generator.event
        event.Retain, event.Severity = active, SEVERITY if active else SEVERITY_OVER
        for name, is_so, words in (
            ("EnabledState", True, ("Enabled", "Disabled")),
            ("ActiveState", active, ("Active", "Inactive")),
            ("AckedState", not active, ("Acknowledged", "Unacknowledged")),
        ):
            setattr(event, name, ua.LocalizedText(words[0 if is_so else 1]))
            setattr(event, f"{name}/Id", is_so)
        await generator.trigger(message=ADVICE.get(signal, signal))
        condition = self._server.get_node(event.NodeId)
        for name, kind in event.data_types.items():  # for who reads, or comes later
            with suppress(ua.uaerrors.BadNoMatch):  # the type's optional ones
                if (value := getattr(event, name)) is not None:
                    node = await condition.get_child([f"0:{part}" for part in name.split("/")])
                    await node.write_value(ua.Variant(value, kind))


def _argument(name: str, kind: Any) -> Any:
    from asyncua import ua

    return ua.Argument(Name=name, DataType=ua.NodeId(kind.value), ValueRank=-1)


def _dint(number: int) -> Any:
    """A number as PackTags have it."""
    from asyncua import ua

    return ua.Variant(int(number), ua.VariantType.Int32)


def _status(name: str) -> Any:
    from asyncua import ua
    from asyncua.ua.status_codes import StatusCodes

    return ua.StatusCode(ua.UInt32(getattr(StatusCodes, name)))
