"""Where on its path a UR is."""

from __future__ import annotations

import socket
import time
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from bracket_cell.remote.channel import Channel
from bracket_cell.remote.child import Child
from bracket_cell.skills.drivers.samples import Sample
from bracket_cell.skills.drivers.stream import FromStream, Sent
from bracket_cell.skills.drivers.streaming import Stream, nearest_s
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_cell.skills.motion.trajectory import joint_move

PATH = joint_move(np.zeros(6), np.full(6, 0.4), MotionSettings())


def told_s(about_s: float, trails_s: float, off_rad: float, seen_s: float | None = None) -> float:
    """The place that is told where the joints trail by a time and are off by an angle.

    Args:
        seen_s: where on the path the arm was seen before.
    """
    (joints,) = PATH.along(np.array([about_s - trails_s]))
    still = np.zeros(6)
    between_s = about_s - trails_s - 0.04 if seen_s is None else seen_s, about_s
    return nearest_s(PATH, between_s, about_s, Sample(0.0, joints + off_rad, still, still))


@pytest.mark.parametrize("trails_s", [0.0, 0.01, 0.04, 0.133, 0.4])
def test_in_the_middle_of_a_path_the_joints_tell_the_place(trails_s: float) -> None:
    middle_s = PATH.duration_s / 2 + trails_s / 2
    assert told_s(middle_s, trails_s, 0.0) == pytest.approx(middle_s - trails_s, abs=4e-3)


def test_an_arm_that_was_told_too_far_is_told_back() -> None:
    middle_s = PATH.duration_s / 2
    assert told_s(middle_s, 0.03, 0.0, seen_s=middle_s - 0.015) == pytest.approx(middle_s - 0.03, abs=1e-3)


@pytest.mark.parametrize("off_rad", [-0.001, 0.001])
def test_where_the_arm_hardly_moves_time_tells_it(off_rad: float) -> None:
    near_end_s = PATH.duration_s - 0.02
    assert told_s(near_end_s, 0.0, off_rad) == pytest.approx(near_end_s, abs=5e-3)


def test_set_points_of_the_path_before_say_nothing_of_the_one_that_begins() -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        child = cast(Child, SimpleNamespace(name="process that streams set points"))
        stream, told = Stream(child, Channel(ours, FromStream)), Channel[Any](theirs, FromStream)
        stream.begin(PATH)
        told.send(Sent(time.monotonic(), 0.5, True, 1), 1.0)
        stream.hear(1.0)
        assert [sent.path_s for sent in stream.sent] == [0.5]
        stream.begin(PATH)
        told.send(Sent(time.monotonic(), None, False, 1), 1.0)  # it had not heard of the new one
        stream.hear(1.0)
        assert not stream.sent
        told.send(Sent(time.monotonic(), 0.01, True, 2), 1.0)
        stream.hear(1.0)
        assert [sent.path_s for sent in stream.sent] == [0.01]
