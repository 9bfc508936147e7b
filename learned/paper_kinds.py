"""The paper's own detectors and planners, which configurations name by their kinds."""

from __future__ import annotations

from cell.interfaces.planning import crops_file
from cell.kinds import Kind

ACTIONS = Kind("learned.actions.model:load_actions", card=True)
RCNN = Kind("learned.parts.boxes:BoxPartDetector.load", "learned.parts.boxes:box_files", card=True)
SEMANTIC = Kind("learned.semantic.paper_planner:PaperPlanner.load", card=True)
GRASP = Kind("learned.grasp.paper_planner:PaperPlanner.load", card=True, crops=crops_file)
