"""What a person does about each sign of trouble, in a line; the catalogues have it in other languages."""

from __future__ import annotations

from collections.abc import Mapping

_DANGER = "Keep away from the arm, press the stop button, and call maintenance"
_LINK, _LOST = "Keep away from the arm, and see to its power and network", "Call maintenance, a device stays lost"
_SLOWLY = "The robot goes slowly for now"
_FINGERS, _CABLE = "Take away what blocks the fingers of the gripper", "Look at the cable of the gripper"
_BUS = "Call maintenance, something disturbs the bus of the gripper"
_CAMERA, _VIEW = "Look at the cable of the camera above", "Clear the view of the camera above"
_HAND, _AWAY = "Show your hand to the camera above, or take it away", "Take your hand away from the robot"
ADVICE: Mapping[str, str] = {  # by signal
    "arm_lost": _LINK,
    "arm_lost_long": _LOST,
    "arm_not_plausible": _DANGER,
    "arm_stale": _LINK,
    "arm_time_wrong": _DANGER,
    "arm_off_path": "Take your hands off the arm",
    "arm_off_path_long": "Take away what holds the arm",
    "arm_not_obeying": _DANGER,
    "arm_slower": _SLOWLY,
    "arm_path_unknown": _SLOWLY,
    "arm_protective_stop": "See what the arm ran into, and free it",
    "arm_safeguard_stop": "Close the safeguard when nobody is inside",
    "arm_emergency_stop": "Release the stop button when it is safe",
    "arm_fault": _DANGER,
    "arm_not_controlled": "Give the arm back to the cell at its pendant",
    "arm_reduced": _SLOWLY,
    "gripper_lost": _CABLE,
    "gripper_lost_long": _LOST,
    "gripper_fault": _FINGERS,
    "gripper_stale": _CABLE,
    "gripper_not_plausible": _FINGERS,
    "gripper_not_obeying": _FINGERS,
    "gripper_refuses": _FINGERS,
    "gripper_restarted_empty": "See that the fingers of the gripper are free",
    "gripper_restarted_holding": "Take the part out of the gripper by hand",
    "gripper_two_nodes": _BUS,
    "gripper_other_master": _BUS,
    "gripper_bus_errors": _BUS,
    "detector_lost": "Call maintenance, a program of the cell has ended",
    "camera_lost": _CAMERA,
    "signals_lost": _CABLE,
    "bench_stale": _CAMERA,
    "bench_in_the_future": _CAMERA,
    "camera_unhealthy": _VIEW,
    "bench_not_seen": _VIEW,
    "camera_moved": "Call maintenance, a camera was moved",
    "hand_not_plausible": _HAND,
    "hand_unknown": _HAND,
    "hand_detector_blind": "Show your bare hand to the camera above",
    "hand_cues_disagree": _HAND,
    "hand_depth_missing": "Take off the dark glove, or tell maintenance of the glare",
    "hand_near": _AWAY,
    "hand_too_near": _AWAY,
    "blind_area": _SLOWLY,
    "tick_late": _SLOWLY,
    "tick_very_late": "Call maintenance, the computer was too slow",
    "rule_warns": "Tell whoever wrote the rule",
    "rule_holds": "Read which rule is broken, and acknowledge it when the cell may go on",
    "rule_stops": "Call whoever wrote the rule",
    "command_contested": "Call whoever edits the tree",
}
ENDS: Mapping[str, str] = {  # by how a run ended; "" where its program is gone and nothing is known
    "finished": "It is done. Take the bracket out",
    "failed": "Put right what is wrong in bracket and tray, then begin again",
    "timeout": "The time is over. Take the bracket out, then begin again",
    "interrupted": "It was stopped. See that the robot is free, then begin again",
    "fault": _DANGER,
    "": _DANGER,
}


def ended_advice(end: str, signal: str = "") -> str:
    """What a person does after a run.

    Args:
        signal: of trouble that was there first where a fault ended it; empty for none.
    """
    return ADVICE.get(signal, ENDS[end]) if end == "fault" else ENDS[end]
