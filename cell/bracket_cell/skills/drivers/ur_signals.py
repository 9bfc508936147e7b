"""Lights, buttons and gates on the terminals of a Universal Robots controller and its tool, and what its safety tells.

Source: Universal Robots, "Real-Time Data Exchange (RTDE) guide": bits of `actual_digital_input_bits` (standard 0 to 7,
configurable 8 to 15, tool 16 and 17), of `safety_status_bits`, analogue inputs, and the masks of the digital outputs.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from bracket_cell.skills.drivers.rtde import FORMS, RtdeConnection
from bracket_cell.skills.drivers.samples import SampleReceiver
from bracket_cell.skills.drivers.settings import UrSignalSettings
from bracket_ground.errors import DeviceFault, words_of
from bracket_ground.interfaces.clock import Clock

RATE_HZ, ANSWER_S = 25.0, 2.0
FIRST_BITS = {"digital": 0, "configurable": 8, "tool": 16}
FACTS = {
    "reduced": 1, "protective_stop": 2, "recovery": 3, "safeguard_stop": 4, "emergency_stop": 7, "violation": 8,
    "fault": 9, "stopped": 10,
}  # fmt: skip
REGISTER = "register"
ANALOG = re.compile(r"((?:tool )?analog [01]) ([<>]) (\S+)\Z")


@dataclass(frozen=True)
class Told:
    """What a controller told of its terminals at one of its cycles.

    Attributes:
        time_s: by its clock; of the run's once it was received.
        bits: of all digital inputs.
        safety: bits of its safety's status.
        registers: boolean registers that are read, by number.
        analog: analogue inputs that are read, by terminal, in [V] or [A].
    """

    time_s: float
    bits: int
    safety: int
    registers: Mapping[int, bool]
    analog: Mapping[str, float]

    def holds(self, terminal: str) -> bool:
        """Whether a terminal, a register or a fact is true."""
        if terminal in FACTS:
            return bool(self.safety >> FACTS[terminal] & 1)
        if (asked := ANALOG.match(terminal)) is not None:
            value, limit = self.analog[asked[1]], float(asked[3])
            return value > limit if asked[2] == ">" else value < limit
        kind, number = _parted(terminal)
        return self.registers[number] if kind == REGISTER else bool(self.bits >> FIRST_BITS[kind] + number & 1)


class _Terminals(RtdeConnection):
    """A connection that tells terminals and sets some; raises as `RtdeConnection`."""

    period_s = 1.0 / RATE_HZ

    def __init__(self, host: str, limit_s: float, reads: Iterable[str], sets: Mapping[str, bool]) -> None:
        compared = {terminal: found[1] for terminal in reads if (found := ANALOG.match(terminal))}
        bits = {*reads} - {*FACTS} - {*compared}
        self._numbers = sorted({number for kind, number in map(_parted, bits) if kind == REGISTER})
        self._analog = sorted({*compared.values()})
        outputs = ("timestamp", "actual_digital_input_bits", "safety_status_bits")
        registers = (f"output_bit_register_{number}" for number in self._numbers)
        super().__init__(host, (*outputs, *registers, *map(_analog, self._analog)), RATE_HZ, limit_s)
        self._names = list(_inputs(sets)) if sets else []
        if self._names:
            answer = self.asked("I", ",".join(self._names).encode())
            types = answer[1:].decode(errors="replace").split(",")
            if any(kind not in FORMS for kind in types):
                self.close()
                text = ", ".join(f"{name} is {kind}" for name, kind in zip(self._names, types, strict=False))
                raise DeviceFault("signals", f"{host} lets nobody set its terminals: {text}; who else sets them?")
            self._recipe, self._put = answer[0], struct.Struct(">" + "".join(FORMS[kind] for kind in types))
            self.put(sets)

    def receive(self) -> Told:
        """The next word of the terminals; raises OSError."""
        time_s, bits, safety, *others = self.values()
        registers, values = others[: len(self._numbers)], others[len(self._numbers) :]
        levels = dict(zip(self._numbers, map(bool, registers), strict=True))
        return Told(time_s, int(bits), int(safety), levels, dict(zip(self._analog, values, strict=True)))

    def put(self, sets: Mapping[str, bool]) -> None:
        """Set all outputs; raises OSError."""
        if self._names:
            values = _inputs(sets)
            body = bytes([self._recipe]) + self._put.pack(*(values[name] for name in self._names))
            self.socket.sendall(struct.pack(">HB", len(body) + 3, ord("U")) + body)


class UrSignals:
    """Implements `Signals` beside whoever moves the arm; needs no control over it.

    Raises:
        DeviceFault: the controller does not answer, or somebody else sets its terminals.
    """

    Settings = UrSignalSettings

    def __init__(self, settings: UrSignalSettings, clock: Clock) -> None:
        self._settings, self._clock = settings, clock
        slower: float = getattr(clock, "slower", 1.0)
        self._outputs = dict.fromkeys(settings.outputs, False)
        self._connection: _Terminals | None = None

        def connect() -> _Terminals:
            found = _Terminals(settings.host, ANSWER_S * slower, settings.inputs.values(), self._sets)
            self._connection = found
            return found

        self._receiver: SampleReceiver[Told] = SampleReceiver(connect, clock, settings.host, slower, "signals")

    def read(self) -> dict[str, bool]:
        """All inputs as last told, and all outputs as last set.

        Raises:
            DeviceFault: the controller is silent.
        """
        newest = self._receiver.newest
        silent_s = self._clock.now_s() - newest.time_s
        if silent_s > self._settings.timeout_s:
            raise DeviceFault("signals", self._receiver.trouble or f"no word of the terminals for {silent_s:.2f} s")
        return {name: newest.holds(terminal) for name, terminal in self._settings.inputs.items()} | self._outputs

    def write(self, name: str, value: bool) -> None:
        """Set an output; one that did not reach the controller is set as soon as it is connected again.

        Raises:
            DeviceFault: there is no such output, or the controller hung up.
        """
        if name not in self._outputs:
            raise DeviceFault("signals", f"no output {name!r}; there are: {', '.join(self._outputs) or 'none'}")
        self._outputs[name] = value
        assert self._connection is not None
        try:
            self._connection.put(self._sets)
        except OSError as error:
            raise DeviceFault("signals", f"{self._settings.host} hung up: {words_of(error)}") from None

    def close(self) -> None:
        """Hang up; outputs stay as they are."""
        self._receiver.close()

    @property
    def _sets(self) -> dict[str, bool]:
        return {self._settings.outputs[name]: value for name, value in self._outputs.items()}


def _parted(terminal: str) -> tuple[str, int]:
    kind, _, number = terminal.partition(" ")
    return kind, int(number)


def _analog(terminal: str) -> str:
    """What the guide calls `analog 0` or `tool analog 0`."""
    where, number = ("tool" if terminal.startswith("tool") else "standard"), terminal[-1]
    return f"{where}_analog_input{number}"


def _inputs(sets: Mapping[str, bool]) -> dict[str, int]:
    """What is sent for outputs that are set so, by the names of the guide."""
    sent: dict[str, int] = {}
    for terminal, value in sets.items():
        kind, number = _parted(terminal)
        if kind == REGISTER:
            sent[f"input_bit_register_{number}"] = int(value)
            continue
        name = f"{'standard' if kind == 'digital' else kind}_digital_output"
        sent[f"{name}_mask"] = sent.get(f"{name}_mask", 0) | 1 << number
        sent[name] = sent.get(name, 0) | int(value) << number
    return sent
