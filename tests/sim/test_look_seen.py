"""Every knob of a look changes what a camera sees, and no look changes what happens."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
import pytest

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.product import Product
from bracket_sim.cell import SimCell
from bracket_sim.rendering.photographer import Image, Sensor
from bracket_sim.rendering.studio import Studio
from bracket_sim.scene.hand import add_hand
from bracket_sim.scene.look import Look
from bracket_sim.scene.look_range import leaves, look_range
from bracket_sim.scene.settings import SimSettings
from bracket_sim.scene.world import build_world

EVERYTHING: dict[str, dict[str, object]] = {
    "light": {"lamps_n": 3},
    "person": {"glove": True, "left_hand": False},
    "camera": {"jpeg": True},
}
SEEN_IN_TIME = ("exposure_s", "dropped_share", "late_share", "late_s")  # tests/sim/test_sensor.py


def full_look() -> dict[str, Any]:
    """A look in which every knob counts."""
    data = look_range("hard").draw(0).model_dump(mode="json")
    return {name: {**section, **EVERYTHING.get(name, {})} for name, section in data.items()}


def changes(section: str) -> list[tuple[str, Look]]:
    """The full look with one value of a section as in another look."""
    other = look_range("varied").draw(7).model_dump(mode="json")
    found = []
    for place, mine, theirs in leaves(full_look()[section], other[section]):
        data = full_look()
        *way, last = (section, *place)
        target: Any = data
        for step in way:
            target = target[step]
        target[last] = (not mine) if isinstance(mine, bool) else theirs if theirs != mine else mine / 2 + 0.01
        found.append((".".join(map(str, place)), Look.model_validate(data)))
    return found


def views(product: Product, bench: Bench, look: Look) -> list[Image]:
    """Both cameras, small."""
    hand = partial(add_hand, bench=bench, person=look.person)
    world = build_world(product, bench, extend=hand, look=look)
    world.set_arm(bench.arm_look_rad)
    studio = Studio(world)
    images = [studio.render(camera, 160, 120).copy() for camera in ("overhead", "wrist")]
    studio.close()
    return images


@pytest.mark.slow
@pytest.mark.parametrize("section", ["light", "surfaces", "person", "things", "mounts"])
def test_every_knob_of_the_scene_is_seen(product: Product, bench: Bench, section: str) -> None:
    before = views(product, bench, Look.model_validate(full_look()))
    unseen = []
    for name, look in changes(section):
        after = views(product, bench, look)
        if all(np.array_equal(one, other) for one, other in zip(before, after, strict=True)):
            unseen.append(name)
    assert unseen == []


def test_every_knob_of_the_camera_is_seen(bench: Bench) -> None:
    size = (bench.wrist.height_px, bench.wrist.width_px, 3)
    clean = np.random.default_rng(0).integers(0, 255, size).astype(np.uint8)

    def shot(look: Look) -> Image:
        return Sensor(bench.wrist, look.camera, np.random.default_rng(1)).spoil(clean)

    before = shot(Look.model_validate(full_look()))
    unseen = [name for name, look in changes("camera") if np.array_equal(before, shot(look))]
    assert unseen == [*SEEN_IN_TIME, "depth_holes"]  # the latter: tests/sim/test_depth.py


def moved(product: Product, bench: Bench, look: object) -> bytes:
    """Joints of the whole world after a second with the person at work, without frames."""
    slow = bench.overhead.model_copy(update={"rate_hz": 0.01})
    settings = SimSettings.model_validate({"look": look})
    blind = bench.model_copy(update={"overhead": slow})
    cell = SimCell(product, blind, settings, "virtual", f"moved-{id(settings)}", 6, "random")
    cell.devices.clock.sleep_until(1.0)
    cell.close()
    return bytes(cell.world.data.qpos.tobytes())


def test_what_happens_is_the_same_under_every_look(product: Product, bench: Bench) -> None:
    same_hand = {"hand_size": 1.0, "left_hand": False}
    expected = moved(product, bench, "nominal")
    assert moved(product, bench, {"base": "varied", "person": same_hand}) == expected
    assert moved(product, bench, {"base": "hard", "person": same_hand}) == expected
