"""Services and actions of ROS 2 over DDS: a service is two topics, an action three services and two topics.

The two middlewares number requests each in its own way: rmw_cyclonedds_cpp before the fields, rmw_fastrtps_cpp beside
them, where this DDS does not let one look: there an answer is the first that comes after the request, and this process
answers nobody.
"""

from __future__ import annotations

import random
import time
import uuid
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any, Generic, Literal, TypeVar

from bracket_cell.plant.dds import LAST, Node, Quality, taken, waited
from bracket_cell.plant.ros_types import empty, message

Middleware = Literal["fastrtps", "cyclonedds"]
CALLS = Quality(kept=10)  # rmw_qos_profile_services_default
LOOKS_S = 0.05  # [s] between looks whether the other end is there
GOALS_KEPT = 16  # whose state a server tells


class Status(IntEnum):
    """Of a goal: action_msgs/GoalStatus."""

    UNKNOWN, ACCEPTED, EXECUTING, CANCELING, SUCCEEDED, CANCELED, ABORTED = range(7)

    @classmethod
    def of(cls, number: int) -> Status:
        """The status of a number; UNKNOWN of any that the message does not define."""
        return cls(number) if 0 <= number < len(cls) else cls.UNKNOWN

    @property
    def over(self) -> bool:
        """It does not change any more."""
        return self >= Status.SUCCEEDED


class Caller:
    """The client of a service, for example of "std_srvs/srv/Trigger"; one call at a time."""

    def __init__(self, node: Node, name: str, kind: str, middleware: Middleware) -> None:
        self.name, self._kind, self._numbered = name, kind, middleware == "cyclonedds"
        self._guid, self._number = random.getrandbits(63), 0
        asks, answers = (message(f"{kind}_{half}", self._numbered) for half in ("Request", "Response"))
        self._answers = node.reader(f"rr{name}Reply", answers, CALLS)
        self._asks, self._request = node.writer(f"rq{name}Request", asks, CALLS), asks

    def there(self, limit_s: float) -> bool:
        """Whether a server is found within the limit."""
        until_s = time.monotonic() + limit_s
        while not (found := self._met):
            if time.monotonic() > until_s:
                return False
            time.sleep(LOOKS_S)
        return found

    def ask(self, **fields: Any) -> None:
        """Send a request; those that are left out are empty."""
        taken(self._answers)
        self._number += 1
        fields = vars(empty(f"{self._kind}_Request")) | fields
        head = {"client_guid": self._guid, "sequence_number": self._number} if self._numbered else {}
        self._asks.write(self._request(**head, **fields))

    def answer(self, limit_s: float) -> Any:
        """Of the newest request, or None."""
        until_s = time.monotonic() + limit_s
        while (left_s := until_s - time.monotonic()) > 0:
            came = waited(self._answers, left_s)
            if came is not None and self._mine(came):
                return came
        return None

    def call(self, limit_s: float, **fields: Any) -> Any:
        """Ask and wait for the answer; None where no server is there or none comes."""
        if not self.there(limit_s):
            return None
        self.ask(**fields)
        return self.answer(limit_s)

    @property
    def _met(self) -> bool:
        return bool(self._asks.get_matched_subscriptions() and self._answers.get_matched_publications())

    def _mine(self, came: Any) -> bool:
        return not self._numbered or (came.client_guid, came.sequence_number) == (self._guid, self._number)


class Answerer:
    """The server of a service, for clients of rmw_cyclonedds_cpp."""

    def __init__(self, node: Node, name: str, kind: str) -> None:
        asks, self._answer = (message(f"{kind}_{half}", True) for half in ("Request", "Response"))
        self._asked = node.reader(f"rq{name}Request", asks, CALLS)
        self._answers = node.writer(f"rr{name}Reply", self._answer, CALLS)

    def asked(self) -> list[Any]:
        """Requests since the last call."""
        return taken(self._asked)

    def reply(self, asked: Any, **fields: Any) -> None:
        """Answer a request."""
        self._answers.write(
            self._answer(client_guid=asked.client_guid, sequence_number=asked.sequence_number, **fields)
        )


class ActionClient:
    """Sends goals of an action, for example of "control_msgs/action/GripperCommand".

    A goal's state is what the server tells on its topic, so that both middlewares' goals are followed alike.
    """

    def __init__(self, node: Node, name: str, kind: str, middleware: Middleware) -> None:
        def caller(part: str, of: str) -> Caller:
            return Caller(node, f"{name}/_action/{part}", of, middleware)

        self.name = name
        self._send = caller("send_goal", f"{kind}_SendGoal")
        self._cancel = caller("cancel_goal", "action_msgs/srv/CancelGoal")
        self._results = caller("get_result", f"{kind}_GetResult")
        self._status = node.subscription(f"{name}/_action/status", "action_msgs/msg/GoalStatusArray", LAST)
        self._feedback = node.subscription(f"{name}/_action/feedback", f"{kind}_FeedbackMessage", CALLS)
        self._known: dict[bytes, Status] = {}

    def there(self, limit_s: float) -> bool:
        """Whether a server is found within the limit."""
        return self._send.there(limit_s) and self._cancel.there(limit_s)

    def send(self, goal: Any) -> bytes:
        """Send a goal without waiting; returns its identifier."""
        name = uuid.uuid4().bytes
        self._send.ask(goal_id=_uuid(name), goal=goal)
        return name

    def refused(self) -> bool:
        """Whether the newest goal was; False while no answer came."""
        answer = self._send.answer(1e-3)
        return answer is not None and not answer.accepted

    def status(self, goal: bytes) -> Status:
        """What is known of a goal by now."""
        for array in taken(self._status):
            self._known = {bytes(goal.goal_info.goal_id.uuid): Status.of(goal.status) for goal in array.status_list}
        return self._known.get(goal, Status.UNKNOWN)

    def feedback(self) -> list[tuple[bytes, Any]]:
        """What was told of goals since the last call."""
        return [(bytes(message.goal_id.uuid), message.feedback) for message in taken(self._feedback)]

    def cancel(self) -> None:
        """Ask to give all goals up."""
        self._cancel.ask()

    def result(self, goal: bytes, limit_s: float) -> Any:
        """How a goal ended, as its kind's `_Result`; None where nobody says."""
        answer = self._results.call(limit_s, goal_id=_uuid(goal))
        return None if answer is None else answer.result


Goal = TypeVar("Goal")


@dataclass
class Held(Generic[Goal]):
    """A goal that a server accepted, and who asked for its result."""

    name: bytes
    goal: Goal
    status: Status = Status.EXECUTING
    result: Any = None
    asked: list[Any] = field(default_factory=list)


class ActionServer:
    """Takes goals of an action, the newest in place of the one before; `serve` must be called often.

    Args:
        accept: whether a goal is taken; called before the one before it is given up.
        cancel: somebody wants the goal given up.
    """

    def __init__(
        self, node: Node, name: str, kind: str, accept: Callable[[Any], bool], cancel: Callable[[], None]
    ) -> None:
        def answerer(part: str, of: str) -> Answerer:
            return Answerer(node, f"{name}/_action/{part}", of)

        self._kind, self._accept, self._cancel = kind, accept, cancel
        self._sent = answerer("send_goal", f"{kind}_SendGoal")
        self._cancels = answerer("cancel_goal", "action_msgs/srv/CancelGoal")
        self._asked = answerer("get_result", f"{kind}_GetResult")
        self._status = node.publisher(f"{name}/_action/status", "action_msgs/msg/GoalStatusArray", LAST)
        self._feedback = node.publisher(f"{name}/_action/feedback", f"{kind}_FeedbackMessage")
        self._goals: list[Held[Any]] = []

    @property
    def active(self) -> bool:
        """Whether a goal is under way."""
        return bool(self._goals) and not self._goals[-1].status.over

    def serve(self) -> None:
        """Answer whoever asked since the last call."""
        for asked in self._sent.asked():
            accepted = self._accept(asked.goal)
            if accepted:
                self.end(Status.CANCELED, empty(f"{self._kind}_Result"))
                self._goals = [*self._goals[1 - GOALS_KEPT :], Held(bytes(asked.goal_id.uuid), asked.goal)]
            self._sent.reply(asked, accepted=accepted, stamp=empty("builtin_interfaces/msg/Time"))
            self._tell()
        for asked in self._cancels.asked():
            mine = list(self._infos()) if self.active else []
            self._cancels.reply(asked, return_code=0 if mine else 3, goals_canceling=mine)  # 3: it is over already
            if mine:
                self._cancel()
        for asked in self._asked.asked():
            held = next((goal for goal in self._goals if goal.name == bytes(asked.goal_id.uuid)), None)
            if held is None or held.status.over:
                self._reply(asked, held)
            else:
                held.asked.append(asked)

    def end(self, status: Status, result: Any) -> None:
        """The goal that is under way has ended so."""
        if self.active:
            held = self._goals[-1]
            held.status, held.result = status, result
            for asked in held.asked:
                self._reply(asked, held)
            self._tell()

    def tell(self, feedback: Any) -> None:
        """Say how the goal goes on."""
        if self.active:
            kind = message(f"{self._kind}_FeedbackMessage")
            self._feedback.write(kind(goal_id=_uuid(self._goals[-1].name), feedback=feedback))

    def _reply(self, asked: Any, held: Held[Any] | None) -> None:
        status, result = (Status.UNKNOWN, None) if held is None else (held.status, held.result)
        self._asked.reply(asked, status=int(status), result=result or empty(f"{self._kind}_Result"))

    def _infos(self) -> Iterator[Any]:
        info = message("action_msgs/msg/GoalInfo")
        yield info(goal_id=_uuid(self._goals[-1].name), stamp=empty("builtin_interfaces/msg/Time"))

    def _tell(self) -> None:
        info, made = message("action_msgs/msg/GoalInfo"), message("action_msgs/msg/GoalStatus")
        stamp = empty("builtin_interfaces/msg/Time")
        statuses = [
            made(goal_info=info(goal_id=_uuid(goal.name), stamp=stamp), status=int(goal.status)) for goal in self._goals
        ]
        self._status.write(message("action_msgs/msg/GoalStatusArray")(status_list=statuses))


def _uuid(name: bytes) -> Any:
    return message("unique_identifier_msgs/msg/UUID")(uuid=list(name))
