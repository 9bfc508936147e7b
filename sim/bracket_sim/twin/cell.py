"""The simulated cell that runs by itself on the wall's time, and what its wires may do with it."""

from __future__ import annotations

import importlib
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Protocol

from bracket_cell.remote import priority
from bracket_ground.errors import InputError
from bracket_sim.cell import SimCell
from bracket_sim.devices.pacing import Pacer
from bracket_sim.twin.arm import TwinArm
from bracket_sim.twin.turn_lock import TurnLock

# What serves the wire of a device, by the kind that the configuration names: MODULE:FUNCTION of (TwinCell, role).
WIRES: Mapping[str, str] = {
    "ur": "bracket_sim.twin.controller:serve_ur",
    "can": "bracket_sim.twin.gripper:serve_can",
    "robotiq_modbus": "bracket_sim.twin.gripper:serve_modbus",
    "robotiq_urcap": "bracket_sim.twin.gripper:serve_urcap",
    "stream": "bracket_sim.twin.cameras:serve_stream",
    "ros2": "bracket_sim.twin.ros2:serve",
}


class Wire(Protocol):
    """Something that listens where a real device would.

    Attributes:
        banner: one line for the terminal: what is served, and where.
    """

    banner: str

    def close(self) -> None:
        """Let go of sockets and files."""
        ...


@dataclass(frozen=True)
class Fault:
    """Something that goes wrong on demand.

    Attributes:
        what: what happens, in words.
        begin: makes it happen; called under the cell's lock, must not wait.
    """

    what: str
    begin: Callable[[], object]


class TwinCell:
    """The simulated cell, its person included, as it goes on by itself.

    One thread advances the world by a control period (8 ms, or 2 ms of an e-series) at a time. Whoever reads or
    changes anything of `sim` takes `lock` meanwhile, for as short as possible: the world waits. All times are the
    world's, which go `slower` times slower than the wall's.

    Attributes:
        lock: held while the world advances.
        sim: world, gripper node, cameras (`bracket_sim.devices.overhead.latest()`), score and person.
        arm: what the controller commands.
        settings: of each device, by role, as plain data: what stands in the configuration, `kind` among it.
        robot: name of the arm's model.
        slower: seconds of the wall for each second of the cell.
        faults: by name; each wire adds its own.
        lost_s: how far the world fell behind the wall for good.

    Args:
        own: what serves the wires of drivers of one's own, by role.
    """

    def __init__(
        self,
        sim: SimCell,
        arm: TwinArm,
        settings: Mapping[str, Mapping[str, Any]],
        robot: str,
        period_s: float,
        slower: float = 1.0,
        own: Mapping[str, Callable[[TwinCell, str], Wire]] = MappingProxyType({}),
    ) -> None:
        self.lock = TurnLock()
        self._own = own
        self.sim, self.arm, self.settings, self.robot, self.slower = sim, arm, settings, robot, slower
        self.period_s = period_s
        self.faults: dict[str, Fault] = {}
        self._each: list[Callable[[float], None]] = []
        self._pacer: Pacer | None = None
        self._ended = False
        self._thread = threading.Thread(target=self._advance, name="world", daemon=True)
        self._stack = ExitStack()
        if sim.worker is not None:
            sim.worker.away = True

    @property
    def lost_s(self) -> float:
        return 0.0 if self._pacer is None else self._pacer.lost_s

    def now_s(self) -> float:
        """Time of the world, since it began."""
        return self.sim.devices.clock.now_s()

    def each_period(self, act: Callable[[float], None]) -> None:
        """Call this with the world's time after every control period, under the lock; it must not wait."""
        self._each.append(act)

    def offer(self, name: str, what: str, begin: Callable[[], object]) -> None:
        """Let `cell twin fault NAME` do something."""
        self.faults[name] = Fault(what, begin)

    def fault(self, name: str) -> str:
        """Make something go wrong; returns what, in words.

        Raises:
            InputError: there is no such fault.
        """
        if name not in self.faults:
            raise InputError(f"no fault {name!r}; legal: {', '.join(sorted(self.faults))}")
        with self.lock:
            self.faults[name].begin()
        return self.faults[name].what

    def person_comes(self) -> None:
        """Somebody begins to work at the bench: wires say so when the first program of the arm begins."""
        if self.sim.worker is not None:
            self.sim.worker.away = False

    def serve(self) -> list[Wire]:
        """Open the wires of all devices, and let time begin.

        Raises:
            InputError: a port is taken.
        """
        wires: list[Wire] = []
        for role, device in self.settings.items():
            serve = self._own.get(role)
            beside = role in ("signals", "panel")  # on the arm's own wires, or without any
            if serve is None and not beside and (place := WIRES.get(str(device.get("kind")))) is not None:
                module, _, name = place.partition(":")
                serve = getattr(importlib.import_module(module), name)
            if serve is not None:
                wire = serve(self, role)
                self._stack.callback(wire.close)
                wires.append(wire)
        self.sim.devices.free_running(True)
        self._thread.start()
        return wires

    def close(self) -> None:
        """Time ends, and all wires are closed."""
        self._ended = True
        if self._thread.is_alive():
            self._thread.join()
        self._stack.close()
        self.sim.close()

    def _advance(self) -> None:
        with priority.preferred():
            self._keep_pace()

    def _keep_pace(self) -> None:
        clock = self.sim.devices.clock
        began_s = time.monotonic() / self.slower - clock.now_s()
        pacer = self._pacer = Pacer(clock, self.period_s, began_s, lambda: time.monotonic() / self.slower)
        while not self._ended:
            time.sleep(max(pacer.due_in_s() * self.slower, 1e-4))
            with self.lock:
                before_s = clock.now_s()
                pacer.step()
                if clock.now_s() > before_s:
                    for act in self._each:
                        act(clock.now_s())
