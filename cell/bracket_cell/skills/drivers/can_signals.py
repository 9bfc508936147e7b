"""Digital signals of a CANopen I/O module (CiA 401): inputs in its TPDO 1, outputs in its RPDO 1."""

from __future__ import annotations

import can

from bracket_cell.skills.drivers.settings import SignalSettings
from bracket_ground.errors import DeviceFault, words_of
from bracket_ground.interfaces.can_bus import open_bus
from bracket_ground.interfaces.clock import Clock

INPUTS, OUTPUTS, NETWORK = 0x180, 0x200, 0x000  # the module's node id is added to the first two
START, FRAMES_A_TICK = 0x01, 500


class CanSignals:
    """The master's end: starts the module, reads its inputs, sets its outputs.

    Args:
        settings: the names of the bits; the module must tell its inputs at least every `timeout_s`.
        bus: opened already; by default the one that the settings name.
    """

    Settings = SignalSettings

    def __init__(self, settings: SignalSettings, clock: Clock, bus: can.BusABC | None = None) -> None:
        self._bus = bus or open_bus(settings.interface, settings.channel, settings.bitrate, role="signals")
        self._clock, self._settings = clock, settings
        self._told = b""  # the inputs
        self._outputs = dict.fromkeys(settings.outputs, False)
        self._told_s: float | None = None
        self._opened_s = clock.now_s()
        self._send(NETWORK, bytes((START, settings.node_id)))

    def read(self) -> dict[str, bool]:
        """All inputs as last told, and all outputs as last set; inputs are left out before the first word of them.

        Raises:
            DeviceFault: the module is silent or does not tell all inputs, or the bus cannot be read.
        """
        self._drain()
        since_s = self._opened_s if self._told_s is None else self._told_s
        silent_s = self._clock.now_s() - since_s
        if silent_s > self._settings.timeout_s:
            raise DeviceFault("signals", f"no word of the inputs for {silent_s:.2f} s")
        bits, told = {} if self._told_s is None else self._settings.inputs, self._told
        if missing := next((name for name, bit in bits.items() if bit >= 8 * len(told)), None):
            raise DeviceFault("signals", f"the module tells {8 * len(told)} inputs; {missing} is bit {bits[missing]}")
        return {name: bool(told[bit // 8] >> bit % 8 & 1) for name, bit in bits.items()} | self._outputs

    def write(self, name: str, value: bool) -> None:
        """Set an output.

        Raises:
            DeviceFault: there is no such output, or the bus cannot be written.
        """
        if name not in self._outputs:
            raise DeviceFault("signals", f"no output {name!r}; there are: {', '.join(self._outputs) or 'none'}")
        self._outputs[name] = value
        bits = sum(1 << self._settings.outputs[name] for name, on in self._outputs.items() if on)
        self._send(OUTPUTS + self._settings.node_id, bits.to_bytes(8, "little"))

    def close(self) -> None:
        """Let go of the bus; outputs stay as they are."""
        self._bus.shutdown()

    def _drain(self) -> None:
        try:
            for _ in range(FRAMES_A_TICK):
                if (message := self._bus.recv(timeout=0)) is None:
                    return
                odd = message.is_error_frame or message.is_remote_frame or message.is_extended_id
                if message.arbitration_id == INPUTS + self._settings.node_id and not odd and message.data:
                    self._told, self._told_s = bytes(message.data), self._clock.now_s()
        except (can.CanError, OSError) as error:
            raise DeviceFault("signals", f"reading the CAN bus failed: {words_of(error)}") from error
        raise DeviceFault("signals", f"more than {FRAMES_A_TICK} frames wait: how old the inputs are, nobody knows")

    def _send(self, identifier: int, data: bytes) -> None:
        try:
            self._bus.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=False))
        except (can.CanError, OSError) as error:
            raise DeviceFault("signals", f"writing to the CAN bus failed: {words_of(error)}") from error
