"""The cell's state as bits, and orders by bits."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import pytest
import yaml

from bracket_cell.configuration import DEFAULT_CONFIGURATION, load_configuration, load_product
from bracket_cell.plant.bits import PlantBits, WaitingBits
from bracket_cell.settings import BitSettings, Shown
from bracket_cell.watching.observer import Outcome, SentCommand, TickRecord
from bracket_ground.errors import InputError
from bracket_ground.interfaces.command import Command, Display
from bracket_ground.interfaces.faults import Action, SafetyDecision
from bracket_ground.interfaces.observation import Observation
from bracket_ground.interfaces.operator import OperatorOrder, Question
from tests.cell.running.test_supervisor import sound

SHOWS: dict[Shown, str] = {name: name.upper() for name in get_args(Shown)}
BITS = BitSettings(
    shows=SHOWS,
    orders={"acknowledge": "ack", "pause": "pause", "finish": "finish"},
    recipe=("r1", "r2"),
)


class Wires:
    """Signals that keep what was written."""

    def __init__(self) -> None:
        self.outputs: dict[str, bool] = {}
        self.written = 0

    def read(self) -> dict[str, bool]:
        return self.outputs

    def write(self, name: str, value: bool) -> None:
        self.outputs[name], self.written = value, self.written + 1

    def close(self) -> None:
        pass


class Rig:
    """Ticks with what a PLC says."""

    def __init__(self) -> None:
        self.wires, self.ordered = Wires(), list[OperatorOrder]()
        self.bits = PlantBits(BITS, self.wires, load_product(load_configuration()), self.ordered.append)

    def tick(
        self, judgement: SafetyDecision | None = None, display: Display | None = None, **said: bool
    ) -> dict[str, bool]:
        seen: Observation = replace(sound(0), signals=said)
        command = Command()
        command.display = display
        self.bits.tick(TickRecord(seen, "RUNNING", (), (), command, SentCommand(), 0.0, False, judgement=judgement))
        return self.wires.outputs


def test_the_state_is_shown_and_only_changes_are_written() -> None:
    rig = Rig()
    shown = rig.tick()
    assert shown["RUNNING"]
    assert not shown["HELD"]
    written = rig.wires.written
    rig.tick()
    assert rig.wires.written == written
    shown = rig.tick(SafetyDecision(Action.HOLD, 0.0, (("hand_unknown", "lost"),)))
    assert shown["HELD"]
    assert not shown["RUNNING"]
    shown = rig.tick(display=Display(questions=(Question(1, "goal", "which one is it?", "", "say it", "", ()),)))
    assert shown["QUESTION"]
    assert rig.tick()["QUESTION"], "a display stays until another one comes"
    rig.bits.close(Outcome("finished", "", 6, 0, 0.3, 0.3))
    assert rig.wires.outputs["OVER"]
    assert not rig.wires.outputs["RUNNING"]


def test_an_input_orders_when_it_becomes_true_and_not_when_a_run_begins_with_it() -> None:
    rig = Rig()
    rig.tick(ack=True, pause=False)
    assert not rig.ordered
    rig.tick(ack=False, pause=True)
    rig.tick(ack=True, pause=True)
    rig.tick(pause=True)  # the PLC is silent: nothing is known of ack
    rig.tick(ack=True, pause=True)
    assert [(order.kind, order.value) for order in rig.ordered] == [("pause", "now"), ("acknowledge", "")]


def test_what_rose_while_the_plc_was_silent_orders_less_and_never_more() -> None:
    rig = Rig()
    rig.tick(finish=False, ack=False)
    rig.tick()  # silent
    rig.tick(finish=True, ack=True)
    rig.tick(finish=True, ack=True)
    assert [order.kind for order in rig.ordered] == ["finish"]
    rig.tick(finish=True, ack=False)
    rig.tick(finish=True, ack=True)
    assert [order.kind for order in rig.ordered] == ["finish", "acknowledge"]


def test_a_recipe_is_a_number() -> None:
    rig = Rig()
    for r1, r2 in ((False, False), (True, False), (True, False), (False, True), (False, False), (True, True)):
        rig.tick(r1=r1, r2=r2)
    assert [(order.kind, order.value) for order in rig.ordered] == [("goal", "g0"), ("goal", "g1"), ("goal", "g2")]


def test_a_recipe_of_which_a_digit_is_not_known_is_no_number() -> None:
    rig = Rig()
    rig.tick(r1=True)
    assert not rig.ordered
    rig.tick(r1=True, r2=True)
    rig.tick()  # silent
    rig.tick(r1=True, r2=True)
    assert [order.value for order in rig.ordered] == ["g2"], "ordered once"


def cell(folder: Path, bits: dict[str, Any], signals: dict[str, Any] | None) -> Path:
    data = yaml.safe_load(DEFAULT_CONFIGURATION.read_text())
    data |= {"product": str(DEFAULT_CONFIGURATION.with_name("products.yaml")), "plant": {"bits": bits}}
    data["devices"] = {"signals": signals} if signals else {}
    path = folder / "cell.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


@pytest.mark.parametrize(
    ("bits", "said"),
    [
        ({"shows": {"held": "lamp"}}, "no 'lamp' there; legal: running"),
        ({"orders": {"stop": "running"}}, "no 'running' there; legal: start"),
        ({"recipe": ["start", "r2"]}, "no 'r2' there; legal: start"),
        ({"shows": {"happy": "running"}}, "happy"),
    ],
)
def test_a_bit_that_is_no_signal_is_an_error_with_its_place(tmp_path: Path, bits: dict[str, Any], said: str) -> None:
    signals = {"kind": "modbus", "inputs": {"start": 0}, "outputs": {"running": 0}}
    with pytest.raises(InputError, match=rf"cell\.yaml:\d+.*{said}"):
        load_configuration(cell(tmp_path, bits, signals))


class Served:
    """A cell that is served; how often a run was begun."""

    def __init__(self) -> None:
        self.busy, self.begun, self.opened = False, list[str](), 0

    def begin(self, operator: str, *, resume: bool) -> None:
        assert self.opened == 0, "the run needs the signals for itself"
        assert not resume
        self.begun.append(operator)
        self.busy = True


def waiting(served: Served, wires: Wires, said: list[str]) -> WaitingBits:
    @contextmanager
    def opened() -> Iterator[Wires]:
        served.opened += 1
        try:
            yield wires
        finally:
            served.opened -= 1

    return WaitingBits(replace_bits(begin="start"), opened, served, said.append)


def replace_bits(**changes: Any) -> BitSettings:
    return BITS.model_copy(update=changes)


def until(true: Callable[[], bool]) -> None:
    end_s = time.monotonic() + 10.0
    while not true():
        assert time.monotonic() < end_s
        time.sleep(0.01)


def test_a_plc_begins_the_next_run_by_a_rising_bit_once_it_is_ready() -> None:
    served, wires, said = Served(), Wires(), list[str]()
    wires.outputs["start"] = True  # since before: nobody asks
    bits = waiting(served, wires, said)
    until(lambda: wires.outputs.get("READY") is True)
    time.sleep(0.2)
    assert served.begun == []
    wires.outputs["start"] = False
    time.sleep(0.2)
    wires.outputs["start"] = True
    until(lambda: served.begun == ["PLC"])
    time.sleep(0.2)
    assert (served.begun, served.opened) == (["PLC"], 0)
    served.busy = False  # the run is over; the bit is still set
    until(lambda: served.opened == 1)
    time.sleep(0.2)
    assert served.begun == ["PLC"]
    bits.close()
    assert served.opened == 0
    assert said == []


def test_signals_that_cannot_be_opened_are_said_once() -> None:
    served, said = Served(), list[str]()
    taken = True

    @contextmanager
    def opened() -> Iterator[Wires]:
        if taken:
            raise InputError("the port is taken")
        yield Wires()

    bits = WaitingBits(replace_bits(begin="start"), opened, served, said.append)
    until(lambda: bool(said))
    bits.close()
    assert said == ["signals: the port is taken"]
