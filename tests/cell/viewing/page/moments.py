"""Eight moments of a shift, each as a rig is brought to it; what the page says in each is tested and photographed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.faults import HAND_TOO_NEAR, SafetyDecision
from bracket_ground.interfaces.faults import Action as Does
from bracket_ground.interfaces.perception import Action, HandSample, PartDetection, PartsView
from bracket_ground.interfaces.planning import UNKNOWN_GOAL
from bracket_ground.interfaces.pose import Pose
from tests.cell.viewing.page.rig import HOLDS, WHICH, PageRig
from tests.trees.nodes.rig import PRODUCT

GOALS = {"g0": 0.33, "g1": 0.33, "g2": 0.32, UNKNOWN_GOAL: 0.02}
TWO = {"g0": 0.52, "g2": 0.46, "g1": 0.01, UNKNOWN_GOAL: 0.01}
SURE = {"g0": 0.97, "g2": 0.02, "g1": 0.01, UNKNOWN_GOAL: 0.0}
PUSHED = SafetyDecision(Does.HOLD, 0.0, (("arm_off_path", "a joint is 0.030 rad off its path"),), ("arm_off_path",))
WAITING = Message("waiting until you {act}", act="place a part")
NEAR = SafetyDecision(Does.HOLD, 0.0, ((HAND_TOO_NEAR, "the hand is too near"),), (HAND_TOO_NEAR,))


def _goal(rig: PageRig, placed: dict[str, str], belief: dict[str, float], goal: str | None) -> None:
    """What is placed, and what is believed: of a goal that is sure everything, else where all likely goals agree."""
    for position, part in placed.items():
        rig.tick(("belief", {"edge": [part, position], "source": "action"}))
    goals = [goal] if goal else [name for name, value in belief.items() if value > 0.1]
    wanted = [PRODUCT.goal_placements(name) for name in goals]
    left = [position for position in PRODUCT.positions if position not in placed]
    agreed = {at: wanted[0][at] for at in left if len({one[at] for one in wanted}) == 1}
    guidance = {part: tuple(at for at, one in agreed.items() if one == part) for part in PRODUCT.parts}
    open_holes = tuple(at for at in left if at not in agreed)
    rig.show(
        guidance=guidance,
        any_part=open_holes,
        goal_belief=belief,
        message=Message("waiting until you {act}", act="place a part"),
    )
    rig.view = replace(rig.view, action=Action("idle", 1.0), hand=HAND)
    rig.runs("WaitForAction")


HAND = HandSample(0.0, (272, 168, 308, 222), (0.80, 0.15), (0.88, 0.17))
SIZE_M, BOX_PX = (0.06, 0.04, 0.06), (0, 0, 9, 9)
PLACES_M = {"o1": (0.33, -0.55), "o2": (0.33, -0.41), "o3": (0.44, -0.55)}
SEEN = tuple(PartDetection(part, 0.97, Pose((x, y, 0.03)), SIZE_M, BOX_PX) for part, (x, y) in PLACES_M.items())
TRAY = PartsView(0, 0.0, SEEN)


def unknown(rig: PageRig) -> None:
    _goal(rig, {}, GOALS, None)


def unsure(rig: PageRig) -> None:
    _goal(rig, {"p1": "o1"}, TWO, None)
    rig.view = replace(rig.view, action=Action("screw", 0.9))


def sure(rig: PageRig) -> None:
    _goal(rig, {"p1": "o1", "p3": "o1"}, SURE, "g0")
    rig.view = replace(rig.view, action=Action("screw", 0.9))
    rig.tick()
    rig.runs("PickPart")
    rig.show(message=Message("moving above {name}", name="o2"))
    rig.tick(("verdict", {"part": "o2", "position": "p4", "decision": "act", "reason": ""}))


def brings(rig: PageRig) -> None:
    sure(rig)
    rig.runs("PlacePart")
    rig.gripper = HOLDS
    rig.show(message=Message("carrying {name}", name="o2"))


def waits(rig: PageRig) -> None:
    brings(rig)
    rig.judgement = NEAR


def question(rig: PageRig) -> None:
    unsure(rig)
    rig.show(questions=(replace(WHICH, positions=()),))


def alarm(rig: PageRig) -> None:
    sure(rig)
    rig.judgement, rig.asks = PUSHED, True


def finished(rig: PageRig) -> None:
    _goal(rig, PRODUCT.goal_placements("g0"), SURE, "g0")
    rig.runs("AssemblyFinished")
    rig.tick()
    rig.runs("MoveTo")
    rig.show(message="the bracket is assembled", guidance={}, any_part=())


MOMENTS: dict[str, Callable[[PageRig], None]] = {
    "unknown": unknown,
    "unsure": unsure,
    "sure": sure,
    "brings": brings,
    "waits": waits,
    "question": question,
    "alarm": alarm,
    "finished": finished,
}


def brought_to(rig: PageRig, moment: str) -> PageRig:
    """The rig in this moment of its third bracket, with a work order."""
    rig.parts = TRAY
    rig.channel.jobs.put('{"id": "A17", "variant": "g0", "amount": 3, "due": "2026-11-26T15:30"}')
    for number in (1, 2):
        rig.tick(("bracket", {"number": number, "edge": "begin"}))
        for place, (position, part) in enumerate(PRODUCT.goal_placements("g0").items()):
            rig.tick(("belief", {"edge": [part, position], "source": "robot" if place % 2 else "action"}))
        rig.tick(("bracket", {"number": number, "edge": "end", "finished": True, "goal": "g0", "order": "A17"}))
    rig.tick(("bracket", {"number": 3, "edge": "begin"}))
    MOMENTS[moment](rig)
    return rig
