"""Contacts of the person's hand or forearm with the robot, or with a part that the robot holds: speed and force.

A simulator's force is no more than an estimate: skin here is as stiff as ISO/TS 15066 says of hands and forearms, and
gives way as a hand of 1.1 kg that is pushed by at most 150 N does.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from bracket_ground.interfaces.devices import TruthEvent
from bracket_ground.interfaces.pose import Array
from bracket_sim.scene import hand, palette
from bracket_sim.scene.world import World

KEPT = 1000  # contacts, of a shift with many more
APART_S = 0.3  # what touches again within this time is the same contact
SKIN, FLESH, PART, FINGER = 1, 2, 4, 8


@dataclass(frozen=True)
class Contact:
    """From the first touch until hand and robot are apart.

    Attributes:
        robot: the link, or the held part, that moved fastest where it was touched.
        human: what it touched: "hand" or "forearm".
        first_m_s: how fast the arm drove the robot's point at the first touch.
        speed_m_s: how fast it drove it at most while they touched; where the person pushes it does not count.
        relative_m_s: how fast the two really moved against each other at most.
        force_n: the greatest force between them.
        point_m: (x, y, z) of the first touch.
    """

    start_s: float
    end_s: float
    robot: str
    human: str
    first_m_s: float
    speed_m_s: float
    relative_m_s: float
    force_n: float
    point_m: tuple[float, float, float]


class ContactMonitor:
    """Looks at every contact in the physics, as often as it is asked to observe.

    Attributes:
        contacts: those that are over, in order; of very many the newest that were told.

    Args:
        driven_rad_s: how fast the arm's joints are driven now, (n,).
    """

    def __init__(self, world: World, driven_rad_s: Callable[[], Array]) -> None:
        self._arm, self._driven_rad_s = world.arm_qvel, driven_rad_s
        self._model, self._data = world.model, world.data
        self._parts = {part.body: part.name for part in world.bodies}
        self._fingers = len(world.holding)
        self._codes = np.array([self._code(geom) for geom in range(world.model.ngeom)], dtype=np.uint8)
        self._human_geoms = (self._codes & (SKIN | FLESH)) > 0
        self._tool = int(world.model.body("tool").id)
        self._now: Contact | None = None
        self._told = self._forgotten = 0
        self._worst: tuple[float, ...] = (0.0, 0.0, 0.0)  # of those forgotten: speed, relative speed, force
        self._begun: list[TruthEvent] = []
        self.contacts: list[Contact] = []

    def observe(self, time_s: float, /) -> None:
        """Look at the contacts of the last physics step."""
        touches: list[tuple[int, int, int]] = []
        if self._data.ncon and self._human_geoms[geoms := self._data.contact.geom].any():
            both = self._codes[geoms[:, 0]] | self._codes[geoms[:, 1]]
            touches = [(int(index), *geoms[index]) for index in np.flatnonzero(both & SKIN)]
            touches += self._through_parts(geoms, both)
        if touches:
            self._extend(self._measure(time_s, touches))
        elif self._now is not None and time_s - self._now.end_s > APART_S:
            self._finish()

    def all(self) -> list[Contact]:
        """Those that are over, and the one that lasts."""
        return [*self.contacts, *([self._now] if self._now is not None else [])]

    def report(self) -> dict[str, object]:
        """Keys of `cell run --json`."""
        found = self.all()
        return {
            "contacts": self._forgotten + len(found),
            "contact_speed_m_s": round(max((self._worst[0], *(contact.speed_m_s for contact in found))), 3),
            "contact_relative_m_s": round(max((self._worst[1], *(contact.relative_m_s for contact in found))), 3),
            "contact_force_n": round(max((self._worst[2], *(contact.force_n for contact in found))), 1),
        }

    def news(self) -> list[TruthEvent]:
        """Contacts that began or ended since the last call."""
        begun, self._begun = self._begun, []
        ended = self.contacts[self._told :]
        self._forget(self.contacts[:-KEPT])
        self._told = len(self.contacts)
        return begun + [TruthEvent(contact.end_s, "contact", {"edge": "end", **vars(contact)}) for contact in ended]

    def _forget(self, oldest: list[Contact]) -> None:
        """Keep of these only how many there were, and the worst."""
        del self.contacts[: len(oldest)]
        self._forgotten += len(oldest)
        for contact in oldest:
            speeds = (contact.speed_m_s, contact.relative_m_s, contact.force_n)
            self._worst = tuple(max(pair) for pair in zip(self._worst, speeds, strict=True))

    def _code(self, geom: int) -> int:
        model = self._model
        name = model.body(model.geom_bodyid[geom]).name
        if name.startswith("hand"):
            touch = int(model.geom_contype[geom]), int(model.geom_conaffinity[geom])
            flesh = hand.CONTYPE, hand.CONAFFINITY
            return SKIN if touch == palette.SKIN_TOUCH else FLESH if touch == flesh else 0
        if int(model.geom_bodyid[geom]) in self._parts:
            return PART
        return FINGER if name.startswith("finger_") else 0

    def _through_parts(self, geoms: NDArray[np.int32], both: NDArray[np.uint8]) -> list[tuple[int, int, int]]:
        """Contacts of the hand with a part that both fingers of the gripper touch, or its cup."""
        touched = np.flatnonzero(both == FLESH | PART)
        gripped = np.flatnonzero(both == FINGER | PART)
        if not len(touched) or not len(gripped):
            return []
        owner = self._model.geom_bodyid
        fingers: dict[int, set[int]] = {}
        for index in gripped:
            part, finger = sorted((int(owner[geom]) for geom in geoms[index]), key=lambda body: body not in self._parts)
            fingers.setdefault(part, set()).add(finger)
        held = {part for part, touching in fingers.items() if len(touching) == self._fingers}
        return [(int(index), *geoms[index]) for index in touched if held & {int(owner[geom]) for geom in geoms[index]}]

    def _measure(self, time_s: float, touches: list[tuple[int, int, int]]) -> Contact:
        """All touches of one moment: the fastest counts, forces add up."""
        force_n, wrench = np.zeros(3), np.zeros(6)
        seen: list[Contact] = []
        for index, first, second in touches:
            human, robot = (first, second) if self._codes[first] & (SKIN | FLESH) else (second, first)
            contact = self._data.contact[index]
            mujoco.mj_contactForce(self._model, self._data, index, wrench)
            sign = 1.0 if human == first else -1.0
            force_n += sign * contact.frame.reshape(3, 3).T @ wrench[:3]
            body, arm = int(self._model.geom_bodyid[robot]), int(self._model.geom_bodyid[human])
            relative = float(np.linalg.norm(self._velocity(body, contact.pos) - self._velocity(arm, contact.pos)))
            fast = self._driven(body, contact.pos)
            x, y, z = (float(value) for value in contact.pos)
            name = self._model.body(body).name
            seen.append(Contact(time_s, time_s, name, self._human(human), fast, fast, relative, 0.0, (x, y, z)))
        worst = max(seen, key=lambda contact: contact.speed_m_s)
        relative = max(contact.relative_m_s for contact in seen)
        return replace(worst, relative_m_s=relative, force_n=float(np.linalg.norm(force_n)))

    def _velocity(self, body: int, point_m: Array) -> Array:
        """Of the point (3,) of a body, in [m/s]."""
        spin_and_speed = np.zeros(6)
        mujoco.mj_objectVelocity(self._model, self._data, mujoco.mjtObj.mjOBJ_XBODY, body, spin_and_speed, 0)
        velocity: Array = spin_and_speed[3:] + np.cross(spin_and_speed[:3], point_m - self._data.xpos[body])
        return velocity

    def _driven(self, body: int, point_m: Array) -> float:
        """How fast the arm's servos move the point (3,) of a body, in [m/s]."""
        jacobian = np.zeros((3, self._model.nv))
        mujoco.mj_jac(self._model, self._data, jacobian, None, point_m, self._tool if body in self._parts else body)
        return float(np.linalg.norm(jacobian[:, self._arm] @ self._driven_rad_s()))

    def _human(self, geom: int) -> str:
        forearm = self._model.geom_group[geom] in (hand.FOREARM_GROUP, hand.FOREARM_SKIN_GROUP)
        return "forearm" if forearm else "hand"

    def _extend(self, now: Contact) -> None:
        if self._now is None:
            self._now = now
            names = ("robot", "human", "speed_m_s", "relative_m_s", "point_m")
            fields = {"edge": "start", **{name: getattr(now, name) for name in names}}
            self._begun.append(TruthEvent(now.start_s, "contact", fields))
            return
        before = self._now
        fastest = now if now.speed_m_s > before.speed_m_s else before
        self._now = replace(
            before,
            end_s=now.end_s,
            robot=fastest.robot,
            human=fastest.human,
            speed_m_s=fastest.speed_m_s,
            relative_m_s=max(before.relative_m_s, now.relative_m_s),
            force_n=max(before.force_n, now.force_n),
        )

    def _finish(self) -> None:
        assert self._now is not None
        self.contacts.append(self._now)
        self._now = None
