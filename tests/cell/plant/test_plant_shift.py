"""A plant works with a served cell: by bits alone and by methods of OPC UA, while broker and network go away."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import yaml

from bracket_cell.configuration import DEFAULT_CONFIGURATION
from bracket_cell.production.book import Book
from tests.processes import started
from tests.sim.twin.rig import slower_now

pytest.importorskip("pymodbus", reason="the extra robotiq is not installed")
ua = pytest.importorskip("asyncua.ua", reason="the extra opcua is not installed")
pytest.importorskip("pysparkplug", reason="the extra mqtt is not installed")
from pymodbus.client import ModbusTcpClient  # noqa: E402
from pymodbus.exceptions import ModbusException  # noqa: E402

from tests.cell.plant.test_opcua import client, folder  # noqa: E402
from tests.cell.plant.test_sparkplug import Host, broker, free_port, needs_broker  # noqa: E402

__all__ = ["folder"]
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore"), needs_broker]
COILS = {"begin": 0, "recipe_1": 1, "recipe_2": 2, "ack": 3, "finish": 4}
SHOWN = {"ready": 0, "running": 1, "held": 2, "over": 3, "watchdog": 4}
GOAL, RECIPE = "g1", 2
AWAY_S, BRACKET_S, POLL_S = 20.0, 400.0, 0.1  # the second of the cell's time


class Plc:
    """A PLC that knows nothing but bits; it asks again where nobody answers."""

    def __init__(self, port: int) -> None:
        self._client = ModbusTcpClient("127.0.0.1", port=port, timeout=3)
        self.bits = dict.fromkeys(SHOWN, False)
        self.beats = 0

    def scan(self, **coils: bool) -> dict[str, bool]:
        """One cycle: write coils, read what the cell shows; the newest where the cell is not there."""
        time.sleep(POLL_S)
        with suppress(ModbusException, OSError):
            if self._client.connected or self._client.connect():  # type: ignore[no-untyped-call]
                for name, value in coils.items():
                    self._client.write_coil(COILS[name], value)
                read = self._client.read_discrete_inputs(0, count=len(SHOWN))
                if not read.isError():
                    told = dict(zip(SHOWN, read.bits, strict=False))
                    self.beats += told["watchdog"] != self.bits["watchdog"]
                    self.bits = told
        return self.bits

    def until(self, bit: str, limit_s: float, **coils: bool) -> None:
        end_s = time.monotonic() + limit_s
        while not self.scan(**coils)[bit]:
            assert time.monotonic() < end_s, f"{bit} never came: {self.bits}"

    def bracket(self, slower: float, meanwhile: Callable[[], None]) -> None:
        """Recipe, begin, no further bracket, and wait until the cell is ready again."""
        digits = {f"recipe_{digit + 1}": bool(RECIPE >> digit & 1) for digit in range(2)}
        self.until("ready", BRACKET_S * slower, begin=False, finish=False, **digits)
        self.until("running", BRACKET_S * slower, begin=True, **digits)
        meanwhile()
        self.until("ready", BRACKET_S * slower, begin=False, finish=True, **digits)

    def close(self) -> None:
        self._client.close()  # type: ignore[no-untyped-call]


def configured(made: Path, ports: dict[str, int], trusted: Path) -> Path:
    data = yaml.safe_load(DEFAULT_CONFIGURATION.read_text())
    data["product"] = str(DEFAULT_CONFIGURATION.with_name("products.yaml"))
    data["devices"]["simulation"] = str(DEFAULT_CONFIGURATION.with_name("sim.yaml"))
    at = f"127.0.0.1:{ports['modbus']}"
    data["devices"]["signals"] = {"kind": "modbus", "at": at, "inputs": COILS, "outputs": SHOWN, "timeout_s": 2.0}
    data["plant"] = {
        "bits": {
            "shows": {name: name for name in SHOWN},
            "orders": {"acknowledge": "ack", "finish": "finish"},
            "begin": "begin",
            "recipe": ["recipe_1", "recipe_2"],
        },
        "mqtt": {"host": "127.0.0.1", "port": ports["mqtt"], "node": "bench 4", "every_s": 0.5},
        "opcua": {"at": f"127.0.0.1:{ports['opcua']}", "trusted": str(trusted)},
    }
    path = made / "cell.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


@contextmanager
def served_cell(config: Path, made: Path, page: int, slower: float) -> Iterator[Book]:
    words = ["serve", "--config", str(config), "--page", str(page), "--look", "none", "--goal", GOAL, "--seed", "62"]
    with started(["cell", *words, f"--real-time={slower:g}"], made) as server:
        assert server.stderr is not None
        for line in server.stderr:
            if line.startswith("code"):
                break
        yield Book(made / "runs" / "book.sqlite")


def test_a_shift_by_bits_alone_and_by_methods_loses_nothing(tmp_path: Path, folder: Path) -> None:
    slower = max(1.0, round(slower_now() / 2))
    ports = {name: free_port() for name in ("modbus", "mqtt", "opcua")}
    config, plc = configured(tmp_path, ports, folder / "trusted"), Plc(ports["modbus"])
    hosts: list[Host] = []

    def broker_restarts() -> None:
        running.__exit__(None, None, None)
        time.sleep(2.0)
        again.__enter__()
        hosts.append(Host(ports["mqtt"]))

    def network_is_gone() -> None:
        plc.close()
        time.sleep(AWAY_S)
        plc.until("running", 60 * slower)

    running, again = broker(ports["mqtt"], tmp_path), broker(ports["mqtt"], tmp_path)
    running.__enter__()
    try:
        with served_cell(config, tmp_path, free_port(), slower) as book:
            plc.bracket(slower, broker_restarts)
            assert "NBIRTH" in hosts[0].kinds(), "who is back hears everything anew"
            plc.bracket(slower, network_is_gone)
            assert plc.beats > 10
            by_bits = book.brackets(last=9)
            assert [(row.variant, bool(row.finished)) for row in by_bits] == 2 * [(GOAL, True)]
            plc.close()
            by_methods(ports["opcua"], folder, slower)
            rows = book.brackets(last=9)
            assert [(row.variant, bool(row.finished)) for row in rows] == 3 * [(GOAL, True)]
            assert len({row.run for row in rows}) == 3
    finally:
        plc.close()
        again.__exit__(None, None, None)
        for host in hosts:
            host.close()


def by_methods(port: int, folder: Path, slower: float) -> None:
    """One bracket by OPC UA; the client is away for a while, as where its network is gone."""
    server: Any = SimpleNamespace(address=f"opc.tcp://127.0.0.1:{port}")
    with client(server, folder / "trusted" / "line-plc.der", folder / "line-plc.pem") as at:
        cell = at.nodes.objects.get_child("2:Cell")
        assert cell.call_method("2:Start", ua.Variant(False)) == [True, ""]
        state_is(at, "EXECUTE", 120 * slower)
        assert cell.call_method("2:Complete") == [True, ""]
    time.sleep(AWAY_S)
    with client(server) as at:
        state_is(at, "COMPLETE", BRACKET_S * slower)


def state_is(at: Any, wanted: str, limit_s: float) -> None:
    end_s = time.monotonic() + limit_s
    node = at.get_node("ns=2;s=Status.State")
    while (told := node.read_data_value(raise_on_bad_status=False).Value.Value) != wanted:
        assert time.monotonic() < end_s, f"it never was {wanted}: {told}"
        time.sleep(0.2)
