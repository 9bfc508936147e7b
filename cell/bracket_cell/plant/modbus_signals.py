"""Digital signals for a PLC that asks for them: discrete inputs and coils of a Modbus TCP server behind the gate."""

from __future__ import annotations

import asyncio
import logging
import threading
from typing import Any

from pymodbus.constants import ExcCodes
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from bracket_cell.skills.drivers.settings import ModbusSignalSettings
from bracket_cell.viewing.gate import Address, Gate, hidden_address
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import Clock

logging.getLogger("pymodbus").setLevel(logging.CRITICAL)

BITS, WORD = 256, 16
READ_INPUTS, WRITES = 2, (5, 15)  # functions: MODBUS Application Protocol 1.1b3, 6.2, 6.5, 6.11
HEADER, LONGEST = 8, 254  # bytes of a request's header with its function, and what may follow: Messaging Guide 1.0b
STARTS_S, STOPS_S = 10.0, 3.0


class ModbusSignals:
    """The cell's end: a PLC writes its coils, and reads its discrete inputs.

    Raises:
        InputError: the port is taken.
    """

    Settings = ModbusSignalSettings

    def __init__(self, settings: ModbusSignalSettings, clock: Clock) -> None:
        self._settings, self._clock = settings, clock
        self._inputs: dict[str, bool] = {}
        self._outputs = dict.fromkeys(settings.outputs, False)
        self._asked_s = clock.now_s()
        self._over, self._ready = threading.Event(), threading.Event()
        self._listening = Address.parse(settings.at, "devices.signals.at").listening()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()), name="Modbus", daemon=True)
        self._thread.start()
        if not self._ready.wait(STARTS_S):
            raise DeviceFault("signals", f"the server at {settings.at} did not begin within {STARTS_S:g} s")

    def read(self) -> dict[str, bool]:
        """All inputs as last written, and all outputs as last set; inputs are left out before the PLC wrote them.

        Raises:
            DeviceFault: the PLC is silent.
        """
        silent_s = self._clock.now_s() - self._asked_s
        if silent_s > self._settings.timeout_s:
            raise DeviceFault("signals", f"the PLC asked and wrote nothing for {silent_s:.1f} s")
        return self._inputs | self._outputs

    def write(self, name: str, value: bool) -> None:
        """Set an output.

        Raises:
            DeviceFault: there is no such output.
        """
        if name not in self._outputs:
            raise DeviceFault("signals", f"no output {name!r}; there are: {', '.join(self._outputs) or 'none'}")
        self._outputs[name] = value

    def close(self) -> None:
        """Serve no longer; harmless when repeated."""
        self._over.set()
        self._thread.join(STOPS_S)

    async def _serve(self) -> None:
        words = [SimData(0, count=BITS // WORD, values=0, datatype=DataType.BITS)]
        unused = [SimData(0, values=0)]
        device = SimDevice(0, (words, words, unused, unused), action=self._asked)
        behind = hidden_address()
        server: Any = ModbusTcpServer(device, address=(behind, 0))
        await server.serve_forever(background=True)
        port = server.transport.sockets[0].getsockname()[1]
        gate = Gate(self._listening, (behind, port), greets=_greets)
        self._ready.set()
        while not self._over.is_set():
            await asyncio.sleep(0.1)
        gate.close()
        await server.shutdown()

    async def _asked(
        self, function: int, _: int, address: int, __: int, words: list[int], values: list[Any] | None
    ) -> ExcCodes | None:
        """A request, before the library answers it."""
        self._asked_s = self._clock.now_s()
        if function == READ_INPUTS:
            words[:] = _words({bit for name, bit in self._settings.outputs.items() if self._outputs[name]})
        elif function in WRITES and values is not None:
            written = {address + number: bool(value) for number, value in enumerate(values)}
            self._inputs |= {name: written[bit] for name, bit in self._settings.inputs.items() if bit in written}
        return None


async def _greets(reader: asyncio.StreamReader) -> bytes:
    """The first request's header; whoever speaks no Modbus stays outside."""
    head = await reader.readexactly(HEADER)
    if head[2:4] != b"\x00\x00" or not 2 <= int.from_bytes(head[4:6], "big") <= LONGEST:
        raise EOFError
    return head


def _words(bits: set[int]) -> list[int]:
    """Bits in words of 16, the lowest first."""
    return [sum(1 << bit % WORD for bit in bits if bit // WORD == word) for word in range(BITS // WORD)]
