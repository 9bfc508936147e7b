"""A page of a run that a test moves on by hand."""

from __future__ import annotations

import base64
import http.client
import json
from collections.abc import Iterable, Mapping
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

from bracket_cell.production.book import Book, RunRow
from bracket_cell.production.bookkeeper import Bookkeeper
from bracket_cell.recording.scene import CellModel
from bracket_cell.running.operator import OperatorChannel
from bracket_cell.running.work_orders import WorkOrders
from bracket_cell.serving.certificate import with_certificate
from bracket_cell.settings import PageSettings
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.viewing.gate import Address
from bracket_cell.viewing.page.page import OperatorPage
from bracket_cell.watching.observer import SentCommand, TickRecord
from bracket_ground.interfaces.command import Command, Display
from bracket_ground.interfaces.faults import SafetyDecision
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.notes import Topic
from bracket_ground.interfaces.observation import ArmState, Image, ObjectStatus, Observation
from bracket_ground.interfaces.operator import Answer, OperatorOrder, Question
from bracket_ground.interfaces.perception import Action, BenchView, HandSample, PartsView
from bracket_ground.interfaces.planning import UNKNOWN_GOAL
from bracket_ground.interfaces.pose import Pose
from btxml.engine.node import StatusChange
from btxml.engine.status import Status
from tests import ROOT
from tests.trees.nodes.rig import BENCH, CONFIGURATION, EMPTY_GRIPPER, EMPTY_HOLES, PRODUCT

MODEL = CellModel(PRODUCT, BENCH, MotionPlanner(PRODUCT, BENCH, CONFIGURATION.motion))
STANDING = ArmState(0.0, BENCH.arm_look_rad, (0.0,) * 6, moving=False)
HOLDS = replace(EMPTY_GRIPPER, object_status=ObjectStatus.CONTACT_CLOSING, opening_m=0.03)
BELIEF = {"g0": 0.1, "g1": 0.85, "g2": 0.03, UNKNOWN_GOAL: 0.02}
GUIDANCE = {"o1": ("p2", "p4"), "o2": ("p1", "p3"), "o3": ("p5",)}
HELP = Question(
    1,
    "help",
    "there is no safety valve (o3) in the tray",
    "there is no safety valve (o3) in the tray (3 times)",
    "put one into the tray with room around it, or place it yourself",
    "o3",
    (Answer("done", "done, look again"), Answer("placed", "I place it myself")),
)
WHICH = Question(
    2,
    "goal",
    "what is in the bracket fits no product that I know",
    "",
    "say which one you build",
    "",
    (
        Answer("g1", "g1 (85%)", PRODUCT.goal_placements("g1")),
        Answer("g0", "g0 (10%)", PRODUCT.goal_placements("g0")),
        Answer(UNKNOWN_GOAL, "a new one"),
    ),
)
MEND = Question(
    3,
    "mend",
    "p5 holds the gate valve (o1), where this bracket needs the safety valve (o3)",
    "",
    "take it out",
    "",
    (Answer("done", "done, look again"), Answer("right", "it is right so")),
    ("p5",),
)

WHERE = Question(
    4,
    "where",
    "where does the gate valve (o1) go: p3 or p5?",
    "",
    "say where I should put it",
    "o1",
    (Answer("p3", "p3"), Answer("p5", "p5"), Answer("placed", "I place it myself")),
    ("p3", "p5"),
)
SURPLUS = Question(
    5,
    "mend",
    "p1, p2, p4 and p6 hold the gate valve (o1), and a bracket takes 3 of them",
    "",
    "take out what does not belong there, or say which one does not",
    "",
    (
        Answer("done", "done, look again"),
        *(Answer(name, f"{name} is wrong") for name in ("p1", "p2", "p4", "p6")),
        Answer("right", "it is right so"),
    ),
    ("p1", "p2", "p4", "p6"),
)


class PageRig:
    """A channel, a page, and a run of as many ticks as a test makes.

    Args:
        slower: of the run; a test that ticks seldom has slow news.

    Attributes:
        said: every order that the cell took, in order.
    """

    def __init__(
        self,
        settings: PageSettings = PageSettings(),  # noqa: B008
        where: Address = Address(0),  # noqa: B008
        slower: float = 60.0,
    ) -> None:
        self.keeper = Bookkeeper(Book(), RunRow(""))
        titles = {goal: PRODUCT.goal_title(goal) for goal in PRODUCT.goals}
        jobs = WorkOrders(titles, book=self.keeper.book)
        self.channel = OperatorChannel(PRODUCT.goals, present=True, brackets=5, jobs=jobs)
        self.said: list[OperatorOrder] = []
        self.tree = load_tree(ROOT / "trees" / "shift.xml", node_registry(PRODUCT))
        told = {"product": PRODUCT.name, "tree": "shift.xml", "seed": "1", "shift": "yes"}
        self.page = OperatorPage(MODEL, told, self.tree, self._obey, where, settings, self.keeper, slower)
        self._host, self._ticks = where.host, 0
        self.image: Image | None = None
        self._running: dict[str, int] = {}
        self._changes: list[StatusChange] = []
        self.display = Display(GUIDANCE, goal_belief=BELIEF, message="moving to look")
        self.judgement, self.asks = SafetyDecision(), False
        self.arm, self.gripper = STANDING, EMPTY_GRIPPER
        self.parts: PartsView | None = None
        hand = HandSample(0.0, (200, 120, 290, 230), (0.7, 0.1), (0.8, 0.1), "o1")
        self.view = BenchView(0, 0.0, hand, EMPTY_HOLES, Action("screw", 0.9))

    def _obey(self, order: OperatorOrder) -> None:
        self.channel.press(order)
        self.said.append(order)

    def show(self, **changes: Any) -> None:
        """Change what the cell shows from the next tick on."""
        self.display = replace(self.display, **changes)
        self.channel.shown(self.display)

    def runs(self, *kinds: str) -> None:
        """From the next tick on just nodes of these kinds run."""
        gone = [kind for kind in self._running if kind not in kinds]
        uids = {type(node).__name__: node.uid for node in self.tree.nodes}
        new = {kind: uids[kind] for kind in kinds if kind not in self._running}
        self._changes = [_change(kind, self._running.pop(kind), Status.RUNNING, Status.SUCCESS) for kind in gone]
        self._changes += [_change(kind, uid, Status.INVALID, Status.RUNNING) for kind, uid in new.items()]
        self._running |= new

    def takes(self, changes: Iterable[StatusChange]) -> None:
        """In the next tick these changes happen, too."""
        self._changes += changes

    def tick(self, *notes: tuple[Topic, dict[str, object]]) -> None:
        """One more tick, with a frame."""
        number, time_s = self._ticks, 0.04 * self._ticks
        self._ticks += 1
        rng = np.random.default_rng(number)
        image = np.full((BENCH.overhead.height_px, BENCH.overhead.width_px, 3), 70, np.uint8)
        image[::8] = rng.integers(60, 200, 3)
        image = image if self.image is None else self.image
        self.page.frame(Frame("overhead", number, time_s, image, Pose((0.0, 0.0, 1.0))))
        seen = Observation(number, time_s, STANDING, EMPTY_GRIPPER, replace(self.view, sequence=number, time_s=time_s))
        seen = replace(
            seen, operator=self.channel.take(time_s, asked=self.asks), acknowledged=self.channel.acknowledged
        )
        seen = replace(seen, arm=self.arm, gripper=self.gripper, parts=self.parts)
        changes, self._changes = tuple(self._changes), []
        command = Command(display=self.display)
        sent, judged = SentCommand(), self.judgement
        record = TickRecord(seen, "RUNNING", changes, notes, command, sent, 0.001, False, None, judged, 0.0, self.asks)
        self.keeper.tick(record)
        self.page.tick(record)

    def look(self, sequence: int) -> None:
        """One more tick, in which the detectors' answer to a frame is there."""
        seen = Observation(sequence, 0.0, STANDING, EMPTY_GRIPPER, replace(self.view, sequence=sequence))
        self.page.tick(TickRecord(seen, "RUNNING", (), (), Command(), SentCommand(), 0.001, False))

    def request(
        self, method: str, path: str, body: bytes | None = None, headers: Mapping[str, str] | None = None
    ) -> tuple[int, str]:
        """Status and text of one request, with just these headers beside Host."""
        connection = http.client.HTTPConnection(self._host, self.page.port, timeout=10)
        try:
            connection.request(method, path, body, dict(headers or {}))
            answer = connection.getresponse()
            return answer.status, answer.read().decode("utf-8", "replace")
        finally:
            connection.close()

    def order(self, value: object, **headers: str) -> tuple[int, str]:
        """Post an order as the page does; headers may be changed."""
        sent = {"Content-Type": "application/json", "X-Cell-Token": self.token}
        sent |= {name.replace("_", "-"): text for name, text in headers.items()}
        body = value if isinstance(value, bytes) else json.dumps(value).encode()
        return self.request("POST", "/order", body, sent)

    @property
    def token(self) -> str:
        return self.page.address.partition("#")[2]


def _change(kind: str, uid: int, old: Status, new: Status) -> StatusChange:
    return StatusChange(f"Shift/{kind}::{uid}", uid, old, new, "")


def certified(folder: Path, host: str) -> tuple[PageSettings, str]:
    """TLS files for a host, and the digest of their key by which Chromium trusts them and no others."""
    settings = with_certificate(PageSettings(), folder, host)
    assert settings.certificate is not None
    key = x509.load_pem_x509_certificate(settings.certificate.read_bytes()).public_key()
    public = key.public_bytes(Encoding.DER, PublicFormat.SubjectPublicKeyInfo)
    return settings, base64.b64encode(sha256(public).digest()).decode()
