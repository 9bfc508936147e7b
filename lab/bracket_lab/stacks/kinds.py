"""The 31 kinds of everyday object in VMRD's order, each made of convex pieces that differ from copy to copy."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bracket_lab.stacks import desk, household
from bracket_sim.stacks.pieces import Thing

Rng = np.random.Generator


def draw_thing(name: str, rng: Rng) -> Thing:
    """A copy of a kind."""
    return _KINDS[name](rng)


_KINDS: dict[str, Callable[[Rng], Thing]] = {
    "box": household.carton,
    "banana": household.banana,
    "notebook": desk.notebook,
    "screwdriver": desk.screwdriver,
    "toothpaste": household.toothpaste,
    "apple": household.apple,
    "stapler": desk.stapler,
    "mobile phone": desk.mobile_phone,
    "bottle": household.bottle,
    "pen": desk.pen,
    "mouse": desk.mouse,
    "umbrella": household.umbrella,
    "remote controller": desk.remote,
    "cans": household.can,
    "tape": desk.tape,
    "knife": desk.knife,
    "wrench": desk.wrench,
    "cup": household.cup,
    "charger": desk.charger,
    "badminton": household.badminton,
    "wallet": household.wallet,
    "wrist developer": household.wrist_developer,
    "glasses": household.glasses,
    "pliers": desk.pliers,
    "headset": household.headset,
    "toothbrush": household.toothbrush,
    "card": desk.card,
    "paper": desk.paper,
    "towel": household.towel,
    "shaver": household.shaver,
    "watch": household.watch,
}
KINDS = tuple(_KINDS)
