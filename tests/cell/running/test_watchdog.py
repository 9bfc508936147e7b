"""Where no tick comes the arm is ordered to stop and people are told what hangs; a signal ends a run in any state."""

from __future__ import annotations

import os
import signal
import socket
import sys
import threading
from pathlib import Path

import pytest

from bracket_cell.running import watchdog
from bracket_cell.running.watchdog import Watchdog
from bracket_ground.interfaces.observation import ArmState
from btxml.engine.status import Status
from tests import ROOT
from tests.cell.fakes import Rig
from tests.processes import started

LIMIT_S = 60.0


class Hanging(Rig):
    """A rig whose arm, when it is ordered to stop, lets go what hangs."""

    def __init__(self) -> None:
        super().__init__()
        self.let_go, self.hung = threading.Event(), False
        self.controller._watchdog.limit_s = 0.05
        plain = self.arm.stop

        def stop() -> None:
            plain()
            self.let_go.set()

        self.arm.stop = stop  # type: ignore[method-assign]

    def hang(self) -> None:
        """Once; ends with the order to stop, or the test fails."""
        if not self.hung:
            self.hung = True
            assert self.let_go.wait(LIMIT_S), "nobody ordered the arm to stop"

    def told(self) -> str:
        return "\n".join(self.observer.messages)


def test_a_node_that_hangs_is_named_and_the_arm_ordered_to_stop(capfd: pytest.CaptureFixture[str]) -> None:
    rig = Hanging()

    def act(tick: int) -> Status:
        if tick == 2:
            rig.hang()
        return Status.SUCCESS if tick == 4 else Status.RUNNING

    outcome, _ = rig.run(act)
    assert outcome.end == "finished", "time is no matter here: the clock of the rig stands"
    said = "the tick of the tree hangs (threading.py"
    assert said in rig.told()
    assert said in capfd.readouterr().err, "people need not wait for the next tick"
    assert "the arm was ordered to stop" in rig.told()


def test_a_driver_that_blocks_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    rig = Hanging()
    plain = rig.arm.state

    def state() -> ArmState:
        if rig.observer.records:
            rig.hang()
        return plain()

    monkeypatch.setattr(rig.arm, "state", state)
    rig.run(lambda tick: Status.SUCCESS if tick == 4 else Status.RUNNING)
    assert "reading the devices hangs" in rig.told()


def test_an_arm_that_takes_no_order_is_not_said_to_stand(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watchdog, "TAKEN_S", 0.05)
    rig, blocked = Hanging(), threading.Event()

    def stop() -> None:
        rig.let_go.set()
        if threading.current_thread() is not threading.main_thread():
            blocked.wait(LIMIT_S)

    rig.arm.stop = stop  # type: ignore[method-assign]

    def act(tick: int) -> Status:
        if tick == 2:
            rig.hang()
            while "did not take" not in "".join(rig.controller._watchdog.news):
                threading.Event().wait(0.01)
        return Status.SUCCESS if tick == 4 else Status.RUNNING

    rig.run(act)
    blocked.set()
    assert "the arm did not take the order to stop within 0.05 s; the arm is not known to stand" in rig.told()


def test_without_a_limit_a_tick_may_take_as_long_as_it_wants(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(watchdog, "GLANCE_S", 0.001)
    rig = Rig()
    glances = threading.Event()
    monkeypatch.setattr(rig.controller._watchdog, "_see_ending", lambda _: glances.set())

    def act(tick: int) -> Status:
        for _ in range(3):
            glances.clear()
            assert glances.wait(LIMIT_S)
        return Status.SUCCESS if tick == 1 else Status.RUNNING

    rig.run(act)
    assert rig.arm.calls == ["stop"], "at its end"


def test_the_service_manager_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    address = tmp_path / "notify.sock"
    monkeypatch.setattr(watchdog, "PING_S", 0.0)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(address))
        manager.settimeout(LIMIT_S)
        monkeypatch.setenv("NOTIFY_SOCKET", str(address))
        heard: list[bytes] = []

        def act(_: int) -> Status:
            heard.append(manager.recv(64))
            return Status.SUCCESS if b"WATCHDOG=1" in heard else Status.RUNNING

        Rig().run(act)
        assert heard[0] == b"READY=1"
        while (last := manager.recv(64)) == b"WATCHDOG=1":
            pass
        assert last == b"STOPPING=1"


def test_signals_are_handled_as_before_once_it_has_ended() -> None:
    before = signal.getsignal(signal.SIGINT)
    with Watchdog().watching() as outer:
        assert signal.getsignal(signal.SIGINT) != before
        with outer.watching():
            pass
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGHUP)
    assert signal.getsignal(signal.SIGINT) == before
    assert "watchdog" not in [thread.name for thread in threading.enumerate()]


def test_on_a_loaded_machine_steps_of_a_simulated_run_may_last_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[str] = []
    monkeypatch.setattr(os, "getloadavg", lambda: (8.0 * (os.cpu_count() or 1), 0.0, 0.0))
    monkeypatch.setattr(signal, "pthread_kill", lambda *_: done.append("broken off"))
    monkeypatch.setattr(Watchdog, "_end", lambda _: done.append("ended"))

    def looked(limit_s: float | None, *ages_s: float) -> list[str]:
        done.clear()
        dog = Watchdog()
        dog.limit_s, dog._step_s, dog._wishes = limit_s, 0.0, [100.0]
        for age_s in ages_s:
            dog._see_ending(100.0 + age_s)
        return list(done)

    assert looked(None, 1.7, 3.9) == []
    assert looked(None, 4.1, 6.4) == ["broken off"]
    assert looked(None, 4.1, 6.6) == ["broken off", "ended"]
    assert looked(1.0, 1.1, 1.8) == ["broken off", "ended"], "an arm waits for nobody"


HANGS = """
import sys, threading, time
from btxml.engine.status import Status
from bracket_cell.running.watchdog import Watchdog
from tests.cell.fakes import Rig

def swallow():
    while True:
        try:
            print("hangs", flush=True)
            time.sleep(60)
        except BaseException:
            pass

def act(tick):
    if tick == 2 and sys.argv[1] == "leaf":
        swallow()
    return Status.RUNNING

if sys.argv[1] == "start":
    with Watchdog().watching():
        swallow()
rig = Rig()
if sys.argv[1] == "driver":
    plain = rig.arm.state
    rig.arm.state = lambda: plain() if not rig.observer.records else swallow()
if sys.argv[1] == "log":
    rig.observer.close = lambda _: swallow()
    swallowing, act = act, lambda tick: Status.SUCCESS
rig.run(act)
"""


@pytest.mark.long
@pytest.mark.parametrize(
    ("where", "signals", "status", "words"),
    [
        ("leaf", 1, 3, "the arm is not known to stand"),
        ("leaf", 3, 3, "the arm is not known to stand"),
        ("driver", 1, 3, "the arm is not known to stand"),
        ("log", 1, 1, "the arm stands, the gripper holds nothing"),
        ("start", 1, 1, "nothing has moved"),
    ],
)
def test_a_signal_ends_a_run_that_swallows_every_exception(where: str, signals: int, status: int, words: str) -> None:
    with started([sys.executable, "-c", HANGS, where], ROOT) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "hangs\n"
        for _ in range(signals):
            os.kill(process.pid, signal.SIGINT)
            threading.Event().wait(1.2 * watchdog.APART_S if signals > 1 else 0.0)
        _, err = process.communicate(timeout=LIMIT_S)
    assert (process.returncode, err) == (status, f"cell: ended at once by SIGINT: {words}\n")


def test_signals_of_a_forked_child_are_its_own() -> None:
    with Watchdog().watching() as dog:
        child = os.fork()
        if not child:
            try:
                os.kill(os.getpid(), signal.SIGHUP)
            finally:
                os._exit(0)
        os.waitpid(child, 0)
        threading.Event().wait(3 * watchdog.GLANCE_S)
        assert dog._wishes == []
