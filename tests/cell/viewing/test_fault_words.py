"""Ten faults of a simulated cell: what the page tells a person to do, in one line of the first cause."""

from __future__ import annotations

import pytest

from bracket_cell.configuration import DEFAULT_CONFIGURATION
from bracket_cell.trees.loading import load_tree
from bracket_cell.trees.node_library import node_registry
from bracket_cell.viewing.instruction import OperatorGuide
from bracket_cell.watching.observer import Observer, Outcome, TickRecord
from bracket_ground.files.words.catalogue import catalogue
from bracket_lab.evaluations.faults import TRIAL, trial
from bracket_sim.faults.injection import Injection
from tests.trees.nodes.rig import PRODUCT

KEEP_AWAY = "The run is over. Keep away from the arm, press the stop button, and call maintenance"
ASKS = ". If all is well, press Acknowledge"
SAID = {
    "arm_lost": ("Keep away from the arm, and see to its power and network", KEEP_AWAY),
    "arm_frozen": ("Keep away from the arm, and see to its power and network", KEEP_AWAY),
    "arm_protective_stop": ("See what the arm ran into, and free it", ""),
    "arm_safeguard": ("Close the safeguard when nobody is inside", ""),
    "arm_emergency": ("Release the stop button when it is safe", ""),
    "arm_not_controlled": ("Give the arm back to the cell at its pendant", ""),
    "gripper_fault": ("Take away what blocks the fingers of the gripper", "The run is over. Take away what blocks"),
    "status_lost": ("Look at the cable of the gripper", "The run is over. Call maintenance, a device stays lost"),
    "camera_frozen": ("Clear the view of the camera above", ""),
    "camera_black": ("Clear the view of the camera above", ""),
}


class Listener(Observer):
    """Keeps each sentence that tells of trouble, and what the run's end says."""

    def __init__(self) -> None:
        tree = load_tree(TRIAL, node_registry(PRODUCT))
        self._guide = OperatorGuide(PRODUCT, lambda: tree)
        self.alarms: list[str] = []
        self.end = ""

    def tick(self, record: TickRecord) -> None:
        self._guide.take(record)
        told = self._guide.now()
        if told.moment == "alarm" and told.words not in self.alarms:
            self.alarms.append(told.words)

    def close(self, outcome: Outcome) -> None:
        self._guide.end(outcome)
        self.end = self._guide.now().words


@pytest.mark.slow
@pytest.mark.parametrize("fault", SAID)
def test_the_first_sentence_of_a_fault_says_what_to_do(fault: str) -> None:
    listener = Listener()
    with trial(DEFAULT_CONFIGURATION, 3) as opened:
        opened.run([listener], Injection(fault, "carry"))
    do, end = SAID[fault]
    assert listener.alarms[0] in (do, do + ASKS)
    assert len(listener.alarms) <= 3, "no flood: the first cause, that it waits, and that it stays"
    assert listener.end.startswith(end or "The run is over. It is done")
    assert do in catalogue("de").texts
