"""Trained policies beside the tick: a device that answers what the arm is to do, with images taken since it was asked.

The log holds what each policy was asked and answered, so a replay needs neither its file nor an image.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from bracket_cell.learned.inference.policy import Policy
from bracket_cell.watching.observer import Observer
from bracket_ground.errors import ModelError
from bracket_ground.interfaces.devices import Devices
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.pose import Array
from btxml.engine.outside import Answer, Asked, Call, as_text

LATENCY_S = 0.1  # of an answer in simulated time, as of detectors whose cards do not tell
FRAME_S = 1.0  # in which a camera must make an image; half of what a detector may take
LOOK_S = 0.005  # between two looks for an image, in a thread
Work = Generator[None, None, Any]


class PolicyDevice(Observer):
    """Asks policies; in simulated time the answers come at the same tick in every run.

    Args:
        joints: of the arm.
        beside: in threads, as time is the wall's.
    """

    def __init__(self, devices: Devices, joints: int, *, beside: bool) -> None:
        self._devices, self._joints, self._beside = devices, joints, beside
        self._frames: dict[str, Frame] = {}
        self._policies: dict[str, Policy] = {}

    def frame(self, frame: Frame) -> None:
        self._frames[frame.camera] = frame

    def ask(self, file: str, seen: Mapping[str, Array]) -> Asked:
        """Begin to ask a policy: {"sha256": of its file, "frames": numbers by camera, "actions": rows}.

        Args:
            seen: as of `observed`.
        """
        try:
            policy = self._policies[file] = self._policies.get(file) or Policy(Path(file), self._joints)
            if policy.cameras and not self._devices.images:
                wants = " and ".join(policy.cameras)
                raise ModelError(f"{file}: wants images of {wants}, and this run makes none (--look none)")
            for camera in policy.cameras:
                (self._devices.overhead if camera == "overhead" else self._devices.wrist).trigger()
        except ModelError as error:
            return _Known(Answer(error=str(error)))
        now_s = self._devices.clock.now_s
        work = self._work(policy, seen, now_s())
        return Call(partial(_drained, work), None, "policy") if self._beside else _Stepped(work, now_s)

    def _work(self, policy: Policy, seen: Mapping[str, Array], asked_s: float) -> Work:
        """Yields while an image is missing that was taken since it was asked; then returns the answer."""
        while missing := [name for name in policy.cameras if self._older(name, asked_s)]:
            if self._devices.clock.now_s() - asked_s > FRAME_S:
                raise ModelError(f"camera {missing[0]} made no image for the policy in {FRAME_S:g} s")
            yield
        frames = {name: self._frames[name] for name in policy.cameras}
        actions = policy.actions(seen, {name: frame.image for name, frame in frames.items()})
        numbers = {name: frame.sequence for name, frame in frames.items()}
        return {"sha256": policy.sha256, "frames": numbers, "actions": actions.tolist()}

    def _older(self, camera: str, asked_s: float) -> bool:
        frame = self._frames.get(camera)
        return frame is None or frame.time_s < asked_s


def _drained(work: Work, _: object) -> Any:
    while True:
        try:
            next(work)
        except StopIteration as end:
            return end.value
        time.sleep(LOOK_S)


class _Known:
    """An answer that is there at once."""

    begun = True

    def __init__(self, answer: Answer) -> None:
        self._answer = answer

    def poll(self, polls: int) -> Answer | None:  # noqa: ARG002 - a log counts them
        return self._answer

    def cancel(self) -> None:
        """Nothing goes on."""


class _Stepped:
    """Works a step each time that it is polled, and hands the answer out LATENCY_S after the last one."""

    begun = True

    def __init__(self, work: Work, now_s: Callable[[], float]) -> None:
        self._work, self._now_s = work, now_s
        self._answer: Answer | None = None
        self._ready_s = 0.0

    def poll(self, polls: int) -> Answer | None:  # noqa: ARG002 - a log counts them
        if self._answer is None:
            try:
                next(self._work)
            except StopIteration as end:
                self._answer = Answer(as_text(end.value))
            except ModelError as error:
                self._answer = Answer(error=str(error))
            self._ready_s = self._now_s() + LATENCY_S
        return self._answer if self._now_s() >= self._ready_s - 1e-9 else None

    def cancel(self) -> None:
        self._work.close()
