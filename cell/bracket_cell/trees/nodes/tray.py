"""Parts of the tray for any job: choose one, put it down anywhere, spots of a grid."""

from __future__ import annotations

import math
from dataclasses import replace

from bracket_cell.trees.nodes.poses import FramedPose, near_bracket, world_pose
from bracket_cell.trees.nodes.services import CellNode
from bracket_cell.trees.nodes.skill_node import HELD, SkillNode
from bracket_cell.trees.vocabulary import Part
from bracket_ground.interfaces.perception import PartsView
from bracket_ground.interfaces.pose import Pose
from bracket_ground.interfaces.skill import Skill
from btxml.engine.errors import NodeError
from btxml.engine.node import FAILURE, SUCCESS
from btxml.engine.ports import InputPort, OutputPort
from btxml.engine.status import Status
from btxml.engine.traits import Traits


class ChoosePart(CellNode):
    """Choose a seen part by type, by place, or any: the nearest to a place, or the easiest to get at."""

    parts = InputPort(PartsView, "parts seen in the tray")
    wanted = InputPort(Part, "only this type; any type if left out", optional=True, name="type")
    near = InputPort(FramedPose, "the nearest to this place", optional=True)
    within_m = InputPort(float, "only as near as this to it in [m]", default=1.0, least=0)
    index = OutputPort(int, "number of the chosen part among the seen ones")
    part = OutputPort(Part, "its type")

    def update(self) -> Status:
        view, wanted = self.parts.get(), self.wanted.get_or("")
        numbers = [number for number, seen in enumerate(view.detections) if wanted in ("", seen.part)]
        if (near := self.near.get_or(None)) is not None:
            place = world_pose(self.services, near).position_m[:2]
            distance_m = {n: math.dist(view.detections[n].world_from_part.position_m[:2], place) for n in numbers}
            numbers = sorted(
                (n for n in numbers if self.compare(distance_m[n], "<=", self.within_m, str(n))),
                key=distance_m.__getitem__,
            )
        else:
            plans = {number: self.services.solve(view, number) for number in numbers}
            numbers = sorted(numbers, key=lambda number: (plans[number].needs_help, -plans[number].graspable))
        if not numbers:
            self.feedback_message = f"no {wanted or 'part'} {'there' if near else 'in the tray'}"
            return FAILURE
        chosen = view.detections[numbers[0]].part
        self.index.set(numbers[0])
        self.part.set(Part(chosen))
        self.feedback_message = f"chose {chosen}, one of {len(numbers)}"
        return SUCCESS


class PutDown(SkillNode):
    """Put the part in the gripper down on a spot of the table or the tray; holes of the bracket are for PlacePart."""

    traits = replace(SkillNode.traits, needs=(HELD,))

    part = InputPort(Part, "type of the part in the gripper")
    spot = InputPort(FramedPose, "what its peg will stand on; x along the part's length")

    _spot: Pose | None = None

    def make_skill(self) -> Skill:
        from bracket_cell.skills import put_down

        services, part, spot = self.services, self.part.get(), self.spot.get()
        self._spot = world_pose(services, spot)
        if near_bracket(services.tools.bench, services.tools.product, self._spot):
            raise NodeError(f"{spot} is at the bracket; PlacePart puts parts there, behind its guard")
        return put_down.PutDown(services.tools.motion, part, self._spot, str(spot), services.memory.standing)

    def update(self) -> Status:
        status = super().update()
        if status is SUCCESS and self._spot is not None:
            from bracket_cell.skills.put_down import standing, stands_at

            part = self.part.get()
            kind = self.tools.product.parts[part]
            self.memory.put_down += (standing(part, kind, stands_at(self._spot, kind.peg_length_m)),)
        return status


class GridSpot(CellNode):
    """Output one spot of a grid, row by row; fails if the grid has no such spot."""

    traits = Traits(instant=True)

    corner = InputPort(FramedPose, "spot number 0; columns go on along its x, rows along its y")
    columns = InputPort(int, "spots in a row")
    rows = InputPort(int, "rows", default=1)
    pitch_m = InputPort(list[float], "from column to column, and from row to row in [m]: 0.08;0.10")
    number = InputPort(int, "which spot, from 0")
    spot = OutputPort(FramedPose, "where it is")

    def update(self) -> Status:
        corner, pitch, number = self.corner.get(), self.pitch_m.get(), self.number.get()
        columns, rows = self.columns.get(), self.rows.get()
        if len(pitch) not in (1, 2) or columns < 1 or rows < 1:
            raise NodeError("a grid has at least one column and one row, and one or two distances")
        if not 0 <= number < columns * rows:
            self.feedback_message = f"the grid has {columns * rows} spots, and none with number {number}"
            return FAILURE
        offset = Pose((number % columns * pitch[0], number // columns * pitch[-1], 0.0))
        self.spot.set(FramedPose(corner.frame, corner.pose @ offset))
        return SUCCESS
