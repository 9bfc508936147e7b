"""A PLC's program runs shifts of a served cell: by methods of OPC UA, and by bits alone; broker and network go away."""

from __future__ import annotations

import asyncio
import os
import shutil
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
import yaml

from bracket_cell.configuration import DEFAULT_CONFIGURATION
from bracket_cell.plant.packml import State
from bracket_cell.production.book import Book, BracketRow
from tests.cable import Cable, cable
from tests.processes import started

sync = pytest.importorskip("asyncua.sync", reason="the extra opcua is not installed")
pytest.importorskip("pymodbus", reason="the extra robotiq is not installed")
pytest.importorskip("pysparkplug", reason="the extra mqtt is not installed")
from asyncua import ua  # noqa: E402 - as above
from asyncua.crypto.cert_gen import setup_self_signed_certificate  # noqa: E402
from cryptography.x509.oid import ExtendedKeyUsageOID  # noqa: E402
from pymodbus.client import ModbusTcpClient  # noqa: E402
from pymodbus.exceptions import ModbusException  # noqa: E402

from tests.cell.plant.test_opcua import Heard, call, free_port  # noqa: E402
from tests.cell.plant.test_sparkplug import Host, broker, needs_broker  # noqa: E402

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore")]

GOAL, RECIPE, BRACKETS_N = "g1", 2, 3  # the product's second goal
SOON_S, BRACKET_S, AWAY_S = 60.0, 300.0, 20.0  # of the cell
POLLS_S, SLOWER = 0.1, 2.0  # of the wall; the cell's pace
COILS = {"begin": 0, "recipe_1": 1, "recipe_2": 2, "ack": 3, "pause": 4}
SHOWN = {"ready": 0, "running": 1, "held": 2, "over": 3, "watchdog": 4}


def until(true: Callable[[], bool], seconds: float, what: str = "it") -> None:
    end_s = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end_s, f"{what} never came"
        time.sleep(0.2)


@contextmanager
def served_cell(folder: Path, slower: float, changes: Mapping[str, Any], *words: str) -> Iterator[Book]:
    """`cell serve` with a simulated person who builds one goal, and its book."""
    shutil.copytree(DEFAULT_CONFIGURATION.parent, folder / "config")
    path = folder / "config" / "cell.yaml"
    data = yaml.safe_load(path.read_text())
    data["devices"] |= changes.get("devices", {})
    path.write_text(yaml.safe_dump(data | {"plant": changes["plant"]}))
    command = [sys.executable, "-m", "bracket_cell", "serve", "--config", str(path), "--page", str(free_port())]
    command += ["--look", "none", "--goal", GOAL, "--seed", "62", f"--real-time={slower:g}", *words]
    with started(command, folder) as server:
        assert server.stderr is not None
        told = []
        for line in server.stderr:
            told.append(line)
            if line.startswith("OPC UA" if "opcua" in changes["plant"] else "code"):
                break
        else:
            pytest.fail("".join(told))
        try:
            yield Book(folder / "runs" / "book.sqlite")
        finally:
            server.terminate()
            server.wait()
            end_runs(folder)


def end_runs(folder: Path) -> None:
    """A run outlives who served it."""
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            if str(folder) in (process / "cmdline").read_text():
                os.kill(int(process.name), signal.SIGKILL)


def ended(book: Book) -> list[tuple[str, bool]]:
    """Variant, and whether it was finished, of each bracket."""
    return [(row.variant, bool(row.finished)) for row in rows(book) if row.finished is not None]


def rows(book: Book) -> list[BracketRow]:
    return list(book.brackets(last=99))


def made_certificate(folder: Path) -> None:
    (folder / "trusted").mkdir()
    key, place, usage = folder / "plc.pem", folder / "trusted" / "plc.der", [ExtendedKeyUsageOID.CLIENT_AUTH]
    asyncio.run(setup_self_signed_certificate(key, place, "urn:plc", "localhost", usage, {"commonName": "plc"}))


@contextmanager
def methods(port: int, folder: Path, slower: float) -> Iterator[Any]:
    """A client with the PLC's certificate; what a line that is cut does to it at the end is its own matter."""
    made = sync.Client(f"opc.tcp://127.0.0.1:{port}/cell/", timeout=SOON_S * slower)
    made.application_uri = "urn:plc"
    made.set_security_string(f"Basic256Sha256,SignAndEncrypt,{folder}/trusted/plc.der,{folder}/plc.pem")
    made.connect()
    try:
        yield made
    finally:
        with suppress(Exception):
            made.disconnect()


def state(at: Any) -> int:
    return int(at.get_node("ns=2;s=Status.StateCurrent").read_value())


def test_a_shift_by_methods_of_opc_ua(tmp_path: Path) -> None:
    port, slower = free_port(), SLOWER
    made_certificate(tmp_path)
    plant = {"opcua": {"at": f"127.0.0.1:{port}", "trusted": "../trusted"}}
    with (
        served_cell(tmp_path, slower, {"plant": plant}, "--shift", "0") as book,
        cable(port) as line,
    ):
        with methods(line.port, tmp_path, slower) as at:
            assert state(at) == State.IDLE
            assert call(at, "Hold") == [False, "no run goes on"]
            assert call(at, "Order", "B1", GOAL, ua.Variant(2, ua.VariantType.UInt32), "") == [True, ""]
            assert call(at, "Start", False) == [True, ""]
            assert call(at, "Start", False) == [False, "a run goes on already"]
            until(lambda: state(at) == State.EXECUTE, SOON_S * slower, "EXECUTE")
            assert call(at, "Hold") == [True, ""]
            until(lambda: state(at) == State.HELD, SOON_S * slower, "HELD")
            assert call(at, "Unhold") == [True, ""]
            until(lambda: state(at) == State.EXECUTE, SOON_S * slower, "EXECUTE")
            line.pull()
            time.sleep(AWAY_S * slower)  # the run does not need its PLC
            line.plug()
        heard = Heard()
        with methods(line.port, tmp_path, slower) as at:
            assert state(at) in (State.EXECUTE, State.SUSPENDED)
            subscription = at.create_subscription(200, heard)
            subscription.subscribe_events(at.nodes.server, at.nodes.base_event_type.get_child("2:BracketEventType"))
            already = len(ended(book))
            until(lambda: len(ended(book)) >= 1, BRACKET_S * slower, "a bracket")
            assert call(at, "Complete") == [True, ""]
            until(lambda: state(at) == State.COMPLETE, BRACKET_S * slower, "COMPLETE")
            until(lambda: heard.events.qsize() >= len(ended(book)) - already, SOON_S, "the events")
            counted = at.get_node("ns=2;s=cell_brackets_total.true").read_value()
            subscription.delete()
        built = ended(book)
        assert 1 <= len(built) <= 2
        assert set(built) == {(GOAL, True)}
        assert {row.order for row in rows(book) if row.finished} == {"B1"}
        assert counted == len(built)
        assert len({row.run for row in rows(book)}) == 1


class BitPlc:
    """A PLC that knows nothing but bits, and asks again where nobody answers.

    Attributes:
        bits: what the cell shows, as last heard.
        beats: changes of its watchdog.
    """

    def __init__(self, port: int, slower: float) -> None:
        self._client: Any = ModbusTcpClient("127.0.0.1", port=port, timeout=3, retries=0)
        self._slower = slower
        self.bits = dict.fromkeys(SHOWN, False)
        self.beats = 0

    def scan(self, **coils: bool) -> dict[str, bool] | None:
        """One cycle: write coils, read what the cell shows; None where it is not there."""
        time.sleep(POLLS_S)
        with suppress(ModbusException, OSError):
            if self._client.connected or self._client.connect():
                for name, value in coils.items():
                    self._client.write_coil(COILS[name], value)
                read = self._client.read_discrete_inputs(0, count=len(SHOWN))
                if not read.isError():
                    told = dict(zip(SHOWN, read.bits, strict=False))
                    self.beats += told["watchdog"] != self.bits["watchdog"]
                    self.bits = told
                    return told
        self._client.close()
        return None

    def until(self, bit: str, limit_s: float, **coils: bool) -> None:
        end_s = time.monotonic() + limit_s * self._slower
        while not (told := self.scan(**coils)) or not told[bit]:
            assert time.monotonic() < end_s, f"{bit} never came: {self.bits}"

    def bracket(self, meanwhile: Callable[[], None]) -> None:
        """Recipe, begin, and wait until the cell is ready again."""
        digits = {f"recipe_{digit + 1}": bool(RECIPE >> digit & 1) for digit in range(2)}
        self.until("ready", BRACKET_S, begin=False, **digits)
        self.until("running", SOON_S, begin=True, **digits)
        meanwhile()
        self.until("ready", BRACKET_S, begin=False, **digits)

    def close(self) -> None:
        self._client.close()


@needs_broker
def test_a_shift_by_bits_alone(tmp_path: Path) -> None:
    modbus, mqtt, slower = free_port(), free_port(), SLOWER
    signals = {"kind": "modbus", "at": f"127.0.0.1:{modbus}", "inputs": COILS, "outputs": SHOWN, "timeout_s": 2.0}
    bits: dict[str, Any] = {"shows": {name: name for name in SHOWN}, "orders": {"acknowledge": "ack", "pause": "pause"}}
    bits |= {"begin": "begin", "recipe": ["recipe_1", "recipe_2"]}
    with cable(modbus) as line, cable(mqtt) as wire:
        sparkplug = {"host": "127.0.0.1", "port": wire.port, "node": "bench 4", "every_s": 0.5}
        changes = {"devices": {"signals": signals}, "plant": {"bits": bits, "mqtt": sparkplug}}
        with served_cell(tmp_path, slower, changes, "--shift", "1") as book:
            plc = BitPlc(line.port, slower)
            try:
                shift(plc, book, (line, wire), mqtt, tmp_path, slower)
            finally:
                plc.close()


def shift(plc: BitPlc, book: Book, lines: tuple[Cable, Cable], mqtt: int, folder: Path, slower: float) -> None:
    """One bracket undisturbed, one while the broker is restarted, one while the network is gone."""

    def network_is_gone() -> None:
        for line in lines:
            line.pull()
        end_s = time.monotonic() + AWAY_S * slower
        while time.monotonic() < end_s:
            assert plc.scan(ack=True) is None, "the network is gone"
        for line in lines:
            line.plug()
        plc.until("running", SOON_S, ack=False)

    def broker_restarts() -> None:
        running.terminate()
        running.wait()
        time.sleep(2.0)
        stack.enter_context(broker(mqtt, folder))
        hosts.append(Host(mqtt))

    with ExitStack() as stack:
        running = stack.enter_context(broker(mqtt, folder))
        hosts = [Host(mqtt)]
        plc.bracket(lambda: until(lambda: "NBIRTH" in hosts[0].kinds(), SOON_S, "a birth"))
        until(lambda: totals(hosts[0]) == 1, SOON_S, "the first count")
        plc.bracket(broker_restarts)
        until(lambda: totals(hosts[1]) == 2, SOON_S, "the second count, of a birth that nobody asked for")
        plc.bracket(network_is_gone)
        plc.until("ready", SOON_S)
        assert plc.beats > 10
        assert ended(book) == BRACKETS_N * [(GOAL, True)]
        assert len({row.run for row in rows(book)}) == BRACKETS_N, "a bit that stays set begins no further run"
        until(lambda: totals(hosts[1]) == BRACKETS_N, SOON_S, "the last count")
        for host in hosts:
            host.close()


def totals(host: Host) -> float:
    """Finished brackets as the plant's host knows them."""
    name = "cell_brackets_total/true"
    return max((metrics[name] for _, metrics, _ in host.heard if name in metrics), default=0.0)
