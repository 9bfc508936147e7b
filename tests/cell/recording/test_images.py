"""Images of the log: in step with a simulation in fixed order, beside a real cell without waiting."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

import pytest

from bracket_cell.recording.images import CALLS_LATER, MOST_WAITING, ImageEncoder
from bracket_ground.interfaces.frame import Frame
from tests.cell.fakes import frame


@pytest.fixture
def slow(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Event]:
    """An encoder that makes no image before it is let go."""
    go = threading.Event()
    encode = ImageEncoder._encode

    def waiting(self: ImageEncoder, one: Frame) -> Any:
        go.wait()
        return encode(self, one)

    monkeypatch.setattr(ImageEncoder, "_encode", waiting)
    yield go
    go.set()


def test_in_step_a_frame_comes_back_a_fixed_number_of_calls_later() -> None:
    encoder = ImageEncoder(80)
    encoder.submit(frame(0))
    assert [len(encoder.take()) for _ in range(CALLS_LATER + 2)] == [0] * CALLS_LATER + [1, 0]
    encoder.close()


def test_beside_a_real_cell_nobody_waits_for_a_slow_encoder(slow: threading.Event) -> None:
    """A8: an encoder that needs 200 ms held every tick for 170 ms."""
    encoder = ImageEncoder(80, in_step=False)
    for number in range(MOST_WAITING + 5):
        encoder.submit(frame(number))
        assert encoder.take() == []
    assert encoder.failed == 5
    slow.set()
    assert [one.sequence for one, _ in encoder.take_all()] == list(range(MOST_WAITING))
    encoder.close()
