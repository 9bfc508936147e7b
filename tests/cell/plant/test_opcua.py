"""A cell by OPC UA: anybody reads, who has a trusted certificate orders, and a PLC sees alarms and brackets come."""

from __future__ import annotations

import asyncio
import json
import queue
import socket
import struct
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from bracket_cell.plant.packml import State, state_of
from bracket_cell.production.book import BracketRow
from bracket_cell.production.samples import Sample
from bracket_cell.settings import OpcuaSettings
from bracket_cell.viewing.door import GREETING_S
from bracket_ground.errors import InputError

sync = pytest.importorskip("asyncua.sync", reason="the extra opcua is not installed")
from asyncua import ua  # noqa: E402 - as above
from asyncua.crypto.cert_gen import setup_self_signed_certificate  # noqa: E402
from asyncua.ua.object_ids import ObjectIds  # noqa: E402
from cryptography.x509.oid import ExtendedKeyUsageOID  # noqa: E402

from bracket_cell.plant.opcua_server import OpcuaServer  # noqa: E402

pytestmark = pytest.mark.filterwarnings("ignore")

HELLO = struct.pack("<4s7I", b"HELF", 32, 0, 65535, 65535, 0, 0, 0)
SOON_S = 30.0
READ = ("0:Retain", ["0:ActiveState", "0:Id"], ["0:AckedState", "0:Id"], "0:Severity", "0:ConditionName")
RUNNING: tuple[Sample, ...] = (("cell_state", {"state": "running"}, 1.0), ("cell_axis_position", {"axis": "1"}, 0.5))


class FakeCell:
    """Takes orders, and is what a test says; implements `Control`."""

    def __init__(self) -> None:
        self.busy, self.silent = True, False
        self.ended: str | None = None
        self.numbers: Sequence[Sample] = RUNNING
        self.ordered: list[Mapping[str, Any]] = []
        self.begun: list[tuple[str, bool]] = []
        self.rows: list[BracketRow] = []

    async def samples(self) -> Sequence[Sample]:
        if self.silent:
            raise TimeoutError
        return self.numbers

    async def order(self, order: Mapping[str, Any]) -> None:
        if order["kind"] == "finish":
            raise InputError("this is no shift")
        self.ordered.append(order)

    def begin(self, operator: str, *, resume: bool) -> None:
        self.begun.append((operator, resume))

    def brackets(self, last: int) -> Sequence[BracketRow]:
        return self.rows[-last:]

    def orders(self) -> Sequence[Mapping[str, Any]]:
        return [{"id": "A17", "variant": "g0", "amount": 3, "due": ""}]


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as free:
        return int(free.getsockname()[1])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With certificates of a client that is trusted, and of a stranger."""
    made = tmp_path_factory.mktemp("opcua")
    (made / "trusted").mkdir()
    for name, place in (("line-plc", "trusted/line-plc.der"), ("stranger", "stranger.der")):
        usage, names = [ExtendedKeyUsageOID.CLIENT_AUTH], {"commonName": name}
        key = made / f"{name}.pem"
        asyncio.run(setup_self_signed_certificate(key, made / place, f"urn:{name}", "localhost", usage, names))
    return made


@pytest.fixture(scope="module")
def served(folder: Path) -> Iterator[tuple[OpcuaServer, FakeCell]]:
    cell = FakeCell()
    settings = OpcuaSettings(at=f"127.0.0.1:{free_port()}", trusted=folder / "trusted")
    server = OpcuaServer(settings, folder / "own", cell, lambda _: None)
    yield server, cell
    server.close()


@contextmanager
def client(server: OpcuaServer, certificate: Path | None = None, key: Path | None = None) -> Iterator[Any]:
    made = sync.Client(server.address)
    if certificate is not None:
        made.application_uri = f"urn:{certificate.stem}"
        made.set_security_string(f"Basic256Sha256,SignAndEncrypt,{certificate},{key}")
    with made:
        yield made


@contextmanager
def plc(server: OpcuaServer, folder: Path) -> Iterator[Any]:
    """The trusted client."""
    with client(server, folder / "trusted" / "line-plc.der", folder / "line-plc.pem") as made:
        yield made


def call(at: Any, method: str, *given: Any) -> list[Any]:
    cell = at.nodes.objects.get_child("2:Cell")
    return list(cell.call_method(f"2:{method}", *given))


def until(node: Any, wanted: object) -> None:
    end = 100
    while node.read_data_value(raise_on_bad_status=False).Value.Value != wanted:
        end -= 1
        assert end, f"it never was {wanted}"
        time.sleep(0.1)


def test_anybody_reads_and_nobody_writes(served: tuple[OpcuaServer, FakeCell]) -> None:
    with client(served[0]) as at:
        state = at.get_node("ns=2;s=Status.StateCurrent")
        until(state, int(State.EXECUTE))
        assert at.get_node("ns=2;s=cell_axis_position.1").read_value() == 0.5
        for node in (state, at.get_node("ns=2;s=cell_state.running")):
            with pytest.raises(ua.uaerrors.UaStatusCodeError):
                node.write_value(0)


def test_only_a_trusted_client_orders(served: tuple[OpcuaServer, FakeCell], folder: Path) -> None:
    server, cell = served
    with client(server) as anybody, pytest.raises(ua.uaerrors.BadUserAccessDenied):
        call(anybody, "Stop")
    with client(server, folder / "stranger.der", folder / "stranger.pem") as stranger:
        assert stranger.get_node("ns=2;s=Status.State").read_value()
        with pytest.raises(ua.uaerrors.BadUserAccessDenied):
            call(stranger, "Stop")
    assert cell.ordered == []
    with plc(server, folder) as at:
        assert call(at, "Hold") == [True, ""]
        assert call(at, "Unhold") == [True, ""]
        assert call(at, "Clear") == [True, ""]
        assert call(at, "Complete") == [False, "this is no shift"]
        assert call(at, "Start", False) == [True, ""]
    assert [order["kind"] for order in cell.ordered] == ["pause", "resume", "acknowledge"]
    assert cell.begun == [("line-plc", False)]
    cell.ordered.clear()


def test_work_orders(served: tuple[OpcuaServer, FakeCell], folder: Path) -> None:
    server, cell = served
    amount = ua.Variant(3, ua.VariantType.UInt32)
    with plc(server, folder) as at:
        assert call(at, "Order", "B1", "g1", amount, "") == [True, ""]
        assert call(at, "Cancel", "A17") == [True, ""]
        assert call(at, "Cancel", "B9") == [False, "there is no work order 'B9'"]
        for wrong in ((), ("B1", "g1", 3, ""), ("B1", "g1", amount), ("B1", ["g1"], amount, "")):
            with pytest.raises(ua.uaerrors.UaStatusCodeError):
                call(at, "Order", *wrong)
    assert [json.loads(order["value"]) for order in cell.ordered] == [
        {"id": "B1", "variant": "g1", "amount": 3},
        {"id": "A17", "variant": "g0", "amount": 3, "cancelled": True},
    ]
    cell.ordered.clear()


class Heard:
    """What a subscription is told."""

    def __init__(self) -> None:
        self.events: queue.Queue[Any] = queue.Queue()

    def event_notification(self, event: Any) -> None:
        self.events.put(event)

    def next(self) -> Any:
        return self.events.get(timeout=SOON_S)


def test_an_alarm_comes_is_acknowledged_and_goes(served: tuple[OpcuaServer, FakeCell], folder: Path) -> None:
    server, cell = served
    with plc(server, folder) as at:
        heard = Heard()
        subscription = at.create_subscription(100, heard)
        of = at.nodes.server.aio_obj, ObjectIds.OffNormalAlarmType
        at.tloop.post(subscription.aio_obj.subscribe_alarms_and_conditions(*of))
        cell.numbers = (("cell_state", {"state": "held"}, 1.0), ("cell_alarm", {"signal": "arm_lost"}, 1.0))
        came = heard.next()
        assert (came.ConditionName, came.Message.Text) == (
            "arm_lost",
            "Keep away from the arm, and see to its power and network",
        )
        assert [getattr(came, f"{state}/Id") for state in ("ActiveState", "AckedState")] == [True, False]
        condition = at.get_node(came.NodeId)
        assert [condition.get_child(path).read_value() for path in READ] == [True, True, False, 700, "arm_lost"]
        acknowledge = ua.NodeId(ua.Int32(ObjectIds.AcknowledgeableConditionType_Acknowledge))
        at.get_node(came.NodeId).call_method(acknowledge, came.EventId, ua.LocalizedText("seen"))
        assert cell.ordered == [{"kind": "acknowledge"}]
        until(at.get_node("ns=2;s=Status.StateCurrent"), int(State.SUSPENDED))
        cell.numbers = RUNNING
        went = heard.next()
        assert [getattr(went, "ActiveState/Id"), went.Retain] == [False, False]
        until(condition.get_child(READ[1]), False)
        subscription.delete()
    cell.ordered.clear()


def test_a_bracket_that_ends_is_an_event_once(served: tuple[OpcuaServer, FakeCell]) -> None:
    server, cell = served
    with client(server) as at:
        heard = Heard()
        subscription = at.create_subscription(100, heard)
        kind = at.nodes.base_event_type.get_child("2:BracketEventType")
        subscription.subscribe_events(at.nodes.server, kind)
        row = BracketRow(
            4, 1.0, 31.0, finished=True, variant="g1", order="B1", run=7, began_utc="2026-01-01T00:00:00+00:00"
        )
        cell.rows.append(row)
        event = heard.next()
        assert (event.Run, event.Number, event.Variant, event.OrderId, event.Seconds) == (7, 4, "g1", "B1", 30.0)
        with pytest.raises(queue.Empty):
            heard.events.get(timeout=1.5)
        subscription.delete()


def test_numbers_that_are_gone_or_of_a_silent_run_are_bad(served: tuple[OpcuaServer, FakeCell]) -> None:
    server, cell = served
    with client(server) as at:
        state, axis = at.get_node("ns=2;s=Status.StateCurrent"), at.get_node("ns=2;s=cell_axis_position.1")
        until(axis, 0.5)
        cell.numbers, cell.busy, cell.ended = (("cell_state", {"state": "over"}, 1.0),), False, "finished"
        until(state, int(State.COMPLETE))
        assert axis.read_data_value(raise_on_bad_status=False).StatusCode.is_bad()
        cell.silent = True
        until(state, None)
        assert state.read_data_value(raise_on_bad_status=False).StatusCode.is_bad()
        cell.silent, cell.numbers, cell.busy = False, RUNNING, True
        until(state, int(State.EXECUTE))


@pytest.mark.parametrize(
    ("now", "busy", "ended", "state"),
    [
        ("running", True, "", State.EXECUTE),
        ("paused", True, "", State.HELD),
        ("held", True, "", State.SUSPENDED),
        ("over", True, None, State.STARTING),
        ("over", False, None, State.IDLE),
        ("over", False, "finished", State.COMPLETE),
        ("over", False, "interrupted", State.STOPPED),
        ("over", False, "fault", State.ABORTED),
        ("over", False, "", State.ABORTED),
    ],
)
def test_states(now: str, busy: bool, ended: str | None, state: State) -> None:
    assert state_of([("cell_state", {"state": now}, 1.0)], busy=busy, ended=ended) is state


def test_clients_are_told_of_the_address_that_people_type(served: tuple[OpcuaServer, FakeCell]) -> None:
    told = sync.Client(served[0].address).connect_and_get_server_endpoints()
    assert {endpoint.EndpointUrl for endpoint in told} == {served[0].address}


@pytest.mark.slow
@pytest.mark.parametrize(
    "begun", [b"", b"HELF\xff\xff\xff\x00", b"GET / HTTP/1.1\r\n\r\n" + b" " * 32, HELLO, HELLO[:-1]]
)
def test_half_greetings_take_no_more_than_their_places(served: tuple[OpcuaServer, FakeCell], begun: bytes) -> None:
    """Whatever they say before a session begins, they are hung up on, and a client comes in meanwhile."""
    host, port = served[0].address.partition("//")[2].partition("/")[0].split(":")
    with ExitStack() as stack:
        callers = [stack.enter_context(socket.create_connection((host, int(port)), 5)) for _ in range(200)]
        for caller in callers:
            with suppress(ConnectionError):
                caller.sendall(begun)
        with client(served[0]) as at:
            assert at.get_node("ns=2;s=Status.UnitModeCurrent").read_value() == 1
        for caller in callers:
            caller.settimeout(4 * GREETING_S)
            with suppress(ConnectionError):
                while caller.recv(64):
                    pass


def test_a_server_that_fails_says_so_at_once_and_later(tmp_path: Path) -> None:
    cell, said = FakeCell(), queue.Queue[str]()
    settings = OpcuaSettings(at=f"127.0.0.1:{free_port()}")
    cell.numbers = ((None, {}, 1.0),)  # type: ignore[assignment]
    with pytest.raises(InputError, match="did not begin: TypeError"):
        OpcuaServer(settings, tmp_path, cell, said.put)
    cell.numbers = RUNNING
    server = OpcuaServer(settings, tmp_path, cell, said.put)
    cell.numbers = ((None, {}, 1.0),)  # type: ignore[assignment]
    assert said.get(timeout=SOON_S).startswith("OPC UA is served no more: TypeError")
    server.close()


def test_a_port_that_is_taken_and_a_certificate_that_is_none_are_told(tmp_path: Path) -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as taken,
        pytest.raises(InputError, match=r"plant\.opcua\.at"),
    ):
        OpcuaServer(OpcuaSettings(at=str(taken.getsockname()[1])), tmp_path, FakeCell(), print)
    (tmp_path / "plc.der").write_bytes(b"no")
    with pytest.raises(InputError, match=r"plc\.der is no certificate"):
        OpcuaServer(OpcuaSettings(at="0", trusted=tmp_path), tmp_path, FakeCell(), print)
    with pytest.raises(InputError, match="No such file"):
        OpcuaServer(OpcuaSettings(at="0", trusted=tmp_path / "none"), tmp_path, FakeCell(), print)
