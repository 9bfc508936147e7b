"""The paper's own detectors and planners, which configurations name by their kinds."""

from __future__ import annotations

from bracket_cell.kinds import Kind
from bracket_ground.interfaces.planning import crops_file

ACTIONS = Kind("bracket_cell.learned.actions.model:load_actions", card=True)
RCNN = Kind(
    "bracket_lab.learned.parts.boxes:BoxPartDetector.load", "bracket_lab.learned.parts.boxes:box_files", card=True
)
SEMANTIC = Kind("bracket_lab.learned.semantic.paper_planner:PaperPlanner.load", card=True)
GRASP = Kind("bracket_lab.learned.grasp.paper_planner:PaperPlanner.load", card=True, crops=crops_file)
