"""Places with names (`bench.places`): take a part from one, put it at one, count what stands there, note a change."""

from __future__ import annotations

from dataclasses import replace

from bracket_cell.trees.nodes.poses import FramedPose
from bracket_cell.trees.nodes.services import CellNode
from bracket_cell.trees.nodes.skill_node import HELD, SkillNode
from bracket_cell.trees.vocabulary import Location, Part
from bracket_ground.files.words.message import Message
from bracket_ground.interfaces.perception import PartDetection
from bracket_ground.interfaces.places import EMPTY
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.skill import Skill
from btxml.engine.errors import NodeError
from btxml.engine.node import FAILURE, RUNNING, SUCCESS
from btxml.engine.ports import InputPort, OutputPort
from btxml.engine.status import Status
from btxml.engine.traits import Traits

CLOSED_M = 0.003  # fingers that are nearer to each other have nothing between them; measured at 0.0 to 0.5 mm
FIRST = -1


class _AtSpot(SkillNode):
    """Base of what is done with a part at a spot of a place."""

    abstract = True

    spot = InputPort(int, "number of the spot, from 0; by default the first that will do", default=FIRST)

    _name = ""
    _number = 0

    def _chosen(self, name: str, numbers: list[int], otherwise: Message) -> int:
        """The spot that was asked for, or the first of those that will do."""
        wanted = self.spot.get()
        fits = [number for number in numbers if wanted in (FIRST, number)]
        if not fits:
            self.memory.failed(otherwise)
            raise NodeError(str(otherwise))
        self._name, self._number = name, fits[0]
        return fits[0]

    def _note(self, part: PartDetection | None) -> None:
        """What stands at the spot from now on."""
        self.services.note_at(self._name, self._number, part)


class Pick(_AtSpot):
    """Take a part from a place of the bench and lift it; a spot where the fingers close on nothing is noted as empty.

    Parts of the tray are for ClearAndGrasp, which sees how they stand.
    """

    traits = replace(SkillNode.traits, gives=(HELD,))

    source = InputPort(Location, "place to take it from", name="from")
    wanted = InputPort(Part, "only this type; any type if left out", optional=True, name="type")
    part = OutputPort(Part, "type of the part that was taken")

    def make_skill(self) -> Skill:
        from bracket_cell.skills import pick_and_place

        services, name, wanted = self.services, self.source.get(), self.wanted.get_or("")
        there = services.at_place(name)
        numbers = [
            number for number, detection in enumerate(there) if detection is not None and wanted in ("", detection.part)
        ]
        nothing = Message("no {part} at {place}", part=wanted or "part", place=name)
        target = there[self._chosen(name, numbers, nothing)]
        assert target is not None
        others = tuple(detection for detection in services.memory.standing if detection is not target)
        if not services.now.observation.gripper.holding:
            services.memory.held_part, services.memory.held_lying = target.part, False
        self.part.set(Part(target.part))
        return pick_and_place.Pick(services.tools.motion, target, others, name)

    def update(self) -> Status:
        status, gripper = super().update(), self.now.observation.gripper
        if status is SUCCESS:
            self._note(None)
        elif status is FAILURE and not gripper.holding and gripper.opening_m < CLOSED_M:
            self._note(None)
            if self.spot.get() == FIRST and self.tools.bench.places[self._name].known_by == "felt":
                return self._next()
        return status

    def _next(self) -> Status:
        """At a place that is felt any other spot may hold a part."""
        try:
            self._skill = self.make_skill()
        except NodeError as error:
            self.feedback_message = str(error)
            return FAILURE
        return RUNNING

    def terminate(self, new_status: Status) -> None:
        if new_status is Status.INVALID and self.now.observation.gripper.holding:
            self._note(None)
        super().terminate(new_status)


class BuiltBeside(CellNode):
    """A sub-assembly of this type stands ready at the place where it is built."""

    node_type = "Condition"
    traits = Traits(instant=True)

    part = InputPort(Part, "type of the part to fetch")
    place = OutputPort(Location, "where it stands")
    spot = OutputPort(FramedPose, "where it stands there")

    def update(self) -> Status:
        services, part = self.services, self.part.get()
        if not services.built(part):
            self.feedback_message = Message("no {part} is built", part=part)
            return FAILURE
        self.feedback_message = place = services.tools.product.parts[part].built_at
        [number, *_] = (
            n
            for n, detection in enumerate(services.at_place(place))
            if detection is not None and detection.part == part
        )
        self.place.set(Location(place))
        self.spot.set(FramedPose(place, Pose((*services.tools.bench.places[place].spots_m[number], 0.0))))
        return SUCCESS


class Place(_AtSpot):
    """Put the part in the gripper at a place of the bench, at a free spot; holes of the bracket are for PlacePart."""

    traits = replace(SkillNode.traits, needs=(HELD,))

    part = InputPort(Part, "type of the part in the gripper")
    at = InputPort(Location, "place to put it")

    def make_skill(self) -> Skill:
        from bracket_cell.skills import put_down

        services, name, part = self.services, self.at.get(), self.part.get()
        place, memory = services.tools.bench.places[name], services.memory
        if not place.takes(part):
            raise NodeError(f"{part} does not belong at {name}, which holds {', '.join(place.holds)}")
        free = [number for number, detection in enumerate(services.at_place(name)) if detection is None]
        number = self._chosen(name, free, Message("no free spot at {place}", place=name))
        spot = place.spot(number)
        return put_down.PutDown(services.tools.motion, part, spot, f"{name} {number}", memory.standing, name)

    def update(self) -> Status:
        status = super().update()
        if status is SUCCESS:
            self._note(self.services.standing_at(self._name, self._number, self.part.get()))
        return status


class CountAt(CellNode):
    """Output how many parts stand at a place of the bench, and how many spots are free, as far as known."""

    traits = Traits(instant=True)

    place = InputPort(Location, "which place")
    wanted = InputPort(Part, "count only this type", optional=True, name="type")
    parts = OutputPort(int, "parts that stand there")
    free = OutputPort(int, "free spots")

    def update(self) -> Status:
        name, wanted = self.place.get(), self.wanted.get_or("")
        there = self.services.at_place(name)
        parts = sum(detection is not None and wanted in ("", detection.part) for detection in there)
        free = sum(detection is None for detection in there)
        self.parts.set(parts)
        self.free.set(free)
        self.feedback_message = f"{parts} at {name}, {free} free"
        return SUCCESS


class NoteAt(CellNode):
    """Note that a person, a conveyor or a machine has filled or emptied a place of the bench."""

    traits = Traits(instant=True)

    place = InputPort(Location, "which place")
    now_there = InputPort(str, f"type of the part at each spot, with ; between them; {EMPTY} for none", name="parts")

    def update(self) -> Status:
        name, product = self.place.get(), self.tools.product
        parts = [part.strip() for part in self.now_there.get().split(";")]
        spots, legal = len(self.services.at_place(name)), (*product.parts, EMPTY)
        if len(parts) > spots or any(part not in legal for part in parts):
            raise NodeError(f"parts is {';'.join(parts)!r}; {name} has {spots} spots, each with {', '.join(legal)}")
        for number in range(spots):
            part = parts[number] if number < len(parts) else EMPTY
            there = None if part == EMPTY else self.services.standing_at(name, number, part)
            self.services.note_at(name, number, there)
        return SUCCESS
