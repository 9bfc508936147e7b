"""The lock of a twin's world goes to who has waited longest."""

from __future__ import annotations

import signal
import threading
import time

import pytest

from bracket_sim.twin.turn_lock import TurnLock

LIMIT_S = 10.0
HOLDS = 200


def test_who_waits_comes_before_who_takes_it_again() -> None:
    lock, requests, overtaken = TurnLock(), [0, 0], 0  # asked, got
    ended = threading.Event()

    def wire() -> None:
        while not ended.is_set():
            requests[0] += 1
            with lock:
                requests[1] += 1

    waiting = threading.Thread(target=wire, daemon=True)
    waiting.start()
    seen = 0
    for _ in range(HOLDS):  # released and taken again at once, as by a world that is behind
        with lock:
            overtaken += requests[0] > requests[1] and seen == requests[0]
            time.sleep(0.002)
            seen = requests[0]
    ended.set()
    waiting.join(LIMIT_S)
    assert overtaken <= 0.05 * HOLDS  # what is left: it had asked in words, but did not wait yet


def test_the_same_thread_may_take_it_twice() -> None:
    lock, order = TurnLock(), []

    def other() -> None:
        with lock:
            order.append("other")

    waiting = threading.Thread(target=other, daemon=True)
    with lock:
        with lock:
            waiting.start()
        time.sleep(0.1)
        order.append("first")
    waiting.join(LIMIT_S)
    assert order == ["first", "other"]


def test_many_threads_never_hold_it_together() -> None:
    lock, inside, most = TurnLock(), [0], [0]

    def take() -> None:
        for _ in range(500):
            with lock:
                inside[0] += 1
                most[0] = max(most[0], inside[0])
                inside[0] -= 1

    threads = [threading.Thread(target=take, daemon=True) for _ in range(8)]
    for one in threads:
        one.start()
    for one in threads:
        one.join(LIMIT_S)
    assert not any(one.is_alive() for one in threads)
    assert most == [1]


def test_who_is_interrupted_while_waiting_loses_no_turn_of_others() -> None:
    lock, holds, ends = TurnLock(), threading.Event(), threading.Event()

    def other() -> None:
        with lock:
            holds.set()
            ends.wait(LIMIT_S)

    holder = threading.Thread(target=other, daemon=True)
    holder.start()
    holds.wait(LIMIT_S)
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.05)
        with pytest.raises(KeyboardInterrupt), lock:
            pass
    finally:
        signal.signal(signal.SIGALRM, before)
    ends.set()
    holder.join(LIMIT_S)
    after = threading.Thread(target=other, daemon=True)
    after.start()
    after.join(LIMIT_S)
    assert not after.is_alive()
