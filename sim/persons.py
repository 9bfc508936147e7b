"""The persons that are shipped, by name, and persons from files."""

from __future__ import annotations

from pathlib import Path

from cell.interfaces.errors import InputError
from cell.interfaces.yaml_file import load_yaml
from sim.hand_motion import MotionSettings
from sim.person import BesideRobot, Grip, Lapses, Person, ScrewHabits, Storage

_ORDINARY = Person(
    order="any",
    pace=(0.6, 2.0),
    pause_s=(0.0, 1.5),
    motion=MotionSettings(speed_spread=0.2, bow=0.08),
    grip=Grip(
        tilt_rad=(0.0, 0.35),
        roll_rad=(-0.06, 0.06),
        curl_rad=(-0.6, 0.35),
        open_m=(0.010, 0.018),
        thumb_m=0.105,
    ),
    storage=Storage(bins="permuted", mixed=0.5, elsewhere=0.15, handed_over=0.15, from_tray=0.05),
    lapses=Lapses(holds=0.25, hesitates=0.1, regrips=0.08, wrong_part=0.03, takes_away=0.04),
    screw=ScrewHabits(
        duration_s=(1.5, 7.0),
        rate_hz=(0.5, 3.0),
        radius_m=(0.002, 0.010),
        yaw_rad=(0.05, 0.6),
        height_m=(0.003, 0.012),
        tool=0.3,
    ),
    robot=BesideRobot(waits=0.9, intrusions_per_min=0.5, intrusion_m_s=(0.4, 1.0), pulls=0.0),
)
_VARIED = _ORDINARY.model_copy(
    update={
        "grip": _ORDINARY.grip.model_copy(
            update={"tilt_rad": (0.0, 0.6), "roll_rad": (-0.2, 0.2), "from_middle_m": (-0.010, 0.029)}
        )
    }
)
PERSONS = {
    "careful": Person(),
    "absent": Person(pause_s=(1e6, 1e6)),  # nobody does anything
    "ordinary": _ORDINARY,
    "varied": _VARIED,  # for data made without physics: there, a pinch holds anywhere
    "careless": _ORDINARY.model_copy(
        update={
            "robot": BesideRobot(waits=0.3, intrusions_per_min=12.0),
            "lapses": _ORDINARY.lapses.model_copy(update={"overlooks": 0.3}),
        }
    ),
}


def load_person(name_or_file: str) -> Person:
    """One of the shipped persons by name, or one from a YAML file.

    Raises:
        InputError: there is none of this name, or the file is wrong.
    """
    if name_or_file in PERSONS:
        return PERSONS[name_or_file]
    path = Path(name_or_file)
    if not path.exists():
        raise InputError(f"no person and no file {name_or_file!r}; legal: {', '.join(PERSONS)}, or a YAML file")
    return load_yaml(path, Person)
