"""Numbers in code by which people are guarded: a record for each judge, all in the signed safety configuration."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from bracket_cell.learned.classical.bench_evidence import SCENE
from bracket_cell.learned.classical.due_change import DueChangeLimits
from bracket_cell.learned.classical.grain import GrainLimits
from bracket_cell.learned.classical.image_health import IMAGE, FreshnessLimits
from bracket_cell.learned.classical.settings import ClassicalLimits
from bracket_cell.learned.classical.track_health import TRACK
from bracket_cell.running import fault_checks, gripper_checks, hand_checks, person_checks, supervisor
from bracket_cell.running.wrist_freshness import WristLimits
from bracket_cell.skills.motion.arm_monitor import ARM
from bracket_cell.skills.motion.arm_outline import OUTLINE
from bracket_cell.skills.motion.contact import CONTACT
from bracket_cell.skills.motion.known_bench import PLAUSIBLE
from bracket_cell.skills.motion.person_space import PERSON
from bracket_cell.skills.motion.retreat import RETREAT
from bracket_cell.skills.motion.separation import SEPARATION
from bracket_cell.skills.motion.settings import MotionLimits, SeparationLimits
from bracket_ground.files.model import attributes

RECORDS: Mapping[str, Any] = {
    "arm_monitor": ARM,
    "arm_outline": OUTLINE,
    "bench_evidence": SCENE,
    "contact": CONTACT,
    "due_change": DueChangeLimits(),
    "fault_checks": fault_checks.LIMITS,
    "freshness": FreshnessLimits(),
    "grain": GrainLimits(),
    "gripper_checks": gripper_checks.LIMITS,
    "hand_checks": hand_checks.LIMITS,
    "image_health": IMAGE,
    "known_bench": PLAUSIBLE,
    "person_checks": person_checks.LIMITS,
    "person_space": PERSON,
    "retreat": RETREAT,
    "separation": SEPARATION,
    "supervisor": supervisor.LIMITS,
    "track_health": TRACK,
    "wrist_freshness": WristLimits(),
}
FIXED: Mapping[str, type] = {  # beside the keys of their sections, and signed with these
    "motion": MotionLimits,
    "motion.separation": SeparationLimits,
    "classical": ClassicalLimits,
}


@dataclass(frozen=True)
class Limit:
    """A number that decides.

    Attributes:
        key: in the safety configuration, below `limits` where it is none of `FIXED`.
        meaning: its unit in brackets, and what it is.
        origin: where the numbers of its record come from.
    """

    key: str
    value: Any
    meaning: str
    origin: str


def values() -> dict[str, dict[str, Any]]:
    """All numbers by record; another release may have others."""
    return {name: asdict(record) for name, record in RECORDS.items()}


def fixed(section: str) -> dict[str, Any]:
    """Numbers of a section that no file sets."""
    return {name: getattr(FIXED[section], name) for name in attributes(FIXED[section])}


def described() -> Iterator[Limit]:
    """All numbers with what their records say of them."""
    records = {name: (type(record), asdict(record)) for name, record in RECORDS.items()}
    for name, (kind, numbers) in (records | {name: (kind, fixed(name)) for name, kind in FIXED.items()}).items():
        summary = " ".join(inspect.cleandoc(kind.__doc__ or "").partition("Attributes:")[0].split())
        meanings = attributes(kind)
        for field, value in numbers.items():
            yield Limit(f"{name}.{field}", value, meanings[field], summary.partition("Origin: ")[2].rstrip("."))
