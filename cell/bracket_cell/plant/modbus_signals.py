"""Signals for a PLC that asks for them: a server of Modbus TCP (Application Protocol 1.1b3, Messaging Guide 1.0b)."""

from __future__ import annotations

import asyncio
import struct
import threading

from bracket_cell.skills.drivers.settings import ModbusSignalSettings
from bracket_cell.viewing import door
from bracket_cell.viewing.door import Caller, Door
from bracket_cell.viewing.gate import KEPT_S, PLACES_N, Address
from bracket_ground.errors import DeviceFault
from bracket_ground.interfaces.clock import Clock

BITS, MOST_READ, MOST_WRITTEN, SHORTEST, LONGEST = 256, 2000, 1968, 2, 254  # MOST of a request; what a header tells
HEADER, SPAN = struct.Struct(">HHHB"), struct.Struct(">HH")  # transaction, protocol, length, unit; address, count
READ_COILS, READ_INPUTS, WRITE_COIL, WRITE_COILS = 1, 2, 5, 15
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3
REFUSED, OFF, ON = 0x80, 0x0000, 0xFF00  # REFUSED is added to the function
STOPS_S = 3.0


class ModbusSignals:
    """The cell's end: a PLC writes its coils, and reads its discrete inputs.

    Raises:
        InputError: the port is taken.
    """

    Settings = ModbusSignalSettings

    def __init__(self, settings: ModbusSignalSettings, clock: Clock) -> None:
        self._settings, self._clock = settings, clock
        self._coils: dict[int, bool] = {}  # that were written
        self._outputs = dict.fromkeys(settings.outputs, False)
        self._asked_s = clock.now_s()
        self._listening = Address.parse(settings.at, "devices.signals.at").listening()
        self._over = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()), name="Modbus", daemon=True)
        self._thread.start()

    def read(self) -> dict[str, bool]:
        """All inputs as last written, and all outputs as last set; inputs are left out before the PLC wrote them.

        Raises:
            DeviceFault: the PLC is silent.
        """
        silent_s = self._clock.now_s() - self._asked_s
        if silent_s > self._settings.timeout_s:
            raise DeviceFault("signals", f"the PLC asked and wrote nothing for {silent_s:.1f} s")
        coils = self._coils
        return {name: coils[bit] for name, bit in self._settings.inputs.items() if bit in coils} | self._outputs

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
        async with Door(self._listening, self._receive, PLACES_N) as self._door:
            while not self._over.is_set():
                await asyncio.sleep(0.1)

    async def _receive(self, caller: Caller) -> None:
        """Answer one request after the other; whoever speaks no Modbus, or does not begin to, is hung up on."""
        reader, writer = await asyncio.open_connection(sock=caller.connection)
        asyncio.get_running_loop().call_later(KEPT_S, self._door.knows, caller)
        try:
            async with asyncio.timeout(door.GREETING_S) as greeting:
                while True:
                    transaction, protocol, length, unit = HEADER.unpack(await reader.readexactly(HEADER.size))
                    if protocol or not SHORTEST <= length <= LONGEST:
                        return
                    answer = self._answer(await reader.readexactly(length - 1))
                    greeting.reschedule(None)
                    writer.write(HEADER.pack(transaction, 0, len(answer) + 1, unit) + answer)
                    await writer.drain()
        finally:
            writer.transport.abort()

    def _answer(self, request: bytes) -> bytes:
        """The answer to a request, both without their headers; an illegal one changes nothing."""
        function, rest = request[0], request[1 + SPAN.size :]
        self._asked_s, written = self._clock.now_s(), 0
        if function not in (READ_COILS, READ_INPUTS, WRITE_COIL, WRITE_COILS):
            return bytes((function | REFUSED, ILLEGAL_FUNCTION))
        address, count = SPAN.unpack_from(request.ljust(1 + SPAN.size, b"\0"), 1)
        size = (count + 7) // 8
        if function == WRITE_COIL:
            legal, written, count = len(request) == 1 + SPAN.size and count in (OFF, ON), int(count == ON), 1
        elif function == WRITE_COILS:
            legal = 0 < count <= MOST_WRITTEN and len(rest) == 1 + size == 1 + rest[0]
            written = int.from_bytes(rest[1:], "little")
        else:
            legal = len(request) == 1 + SPAN.size and 0 < count <= MOST_READ
        if not legal or address + count > BITS:
            return bytes((function | REFUSED, ILLEGAL_ADDRESS if legal else ILLEGAL_VALUE))
        if function in (WRITE_COIL, WRITE_COILS):
            self._coils = self._coils | {address + bit: bool(written >> bit & 1) for bit in range(count)}
            return request[: 1 + SPAN.size]
        outputs = {bit: self._outputs[name] for name, bit in self._settings.outputs.items()}
        levels = self._coils if function == READ_COILS else outputs
        bits = sum(levels.get(address + bit, False) << bit for bit in range(count))
        return bytes((function, size)) + bits.to_bytes(size, "little")
