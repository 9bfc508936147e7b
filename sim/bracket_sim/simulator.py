"""What the cell asks of its simulator (`bracket_cell.simulator.Simulator`); MuJoCo is loaded where it is needed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from bracket_cell.remote.detecting import DetectByCamera
from bracket_ground.interfaces.devices import Devices
from bracket_ground.interfaces.product import Product
from bracket_sim.rendering.available import chosen_backend, remedy, renders
from bracket_sim.rendering.available import missing_library as missing_library
from bracket_sim.scene.look_range import LookFile, look_range
from bracket_sim.scene.person import Person, load_person
from bracket_sim.scene.settings import SimSettings as Settings
from bracket_sim.scene.settings import settings_of

if TYPE_CHECKING:
    from bracket_cell.configuration import Configuration
    from bracket_ground.files.model import Location, Model
    from bracket_ground.interfaces.bench import Bench
    from bracket_sim.faults.injection import Injection, Injections
    from bracket_sim.process.messages import Drawn, Pace


def changed(settings: Model, look: str | None = None, person: str | None = None, **others: bool) -> Model:
    """The settings with another look or people.

    Args:
        look: a preset, a section of it as in "hard:light", or a look file.
        person: a person's name or file; several with commas between take turns in a shift, a bracket each.
    """
    changes: dict[str, object] = dict(others)
    if look is not None:
        changes["look"] = look_range(look)
    if person is not None:
        people = tuple(load_person(name.strip()) for name in person.split(","))
        changes |= {"person": people[0], "people": people if len(people) > 1 else ()}
    return settings.model_copy(update=changes)


def injected(text: str, joints: int) -> Injection | Injections:
    """Faults to put into a run, from FAULT@STATE[,FAULT@STATE...], for an arm of so many joints.

    Raises:
        InputError: there is no such fault or state.
    """
    from bracket_sim.faults.injection import Injection

    return Injection.parse(text, joints)


def attachments(settings: Model, seed: int) -> dict[str, tuple[str, bytes]]:
    """The settings, and the look that the seed drew."""
    look = yaml.safe_dump(settings_of(settings).look.draw(seed).model_dump(mode="json"))
    return {
        "simulation.json": ("application/json", settings.model_dump_json().encode()),
        "look.yaml": ("application/yaml", look.encode()),
    }


def look_name(settings: Model) -> str:
    """The name of the configured look."""
    return settings_of(settings).look.name


def opened(
    configuration: Configuration,
    product: Product,
    seed: int,
    goal: str = "random",
    rendered: bool = True,
    detect: Callable[[], DetectByCamera] | None = None,
) -> Devices:
    """The devices of a simulated cell in this process."""
    from bracket_sim.process.no_render_host import without_pixels
    from bracket_sim.process.opening import open_simulation

    cell = open_simulation(configuration, product, seed, goal, rendered, detect)
    return cell.devices if rendered else without_pixels(cell, configuration, product)


def own_world(configuration: Configuration, product: Product, seed: int, goal: str) -> Devices:
    """The devices of a world in a process of its own."""
    from bracket_sim.process import opening

    return opening.own_world(configuration, product, seed, goal).devices


def connected(configuration: Configuration, product: Product, address: Path, pace: Pace) -> Devices:
    """The devices of a world at an address."""
    from bracket_sim.process.opening import connect

    return connect(configuration, product, address, pace).devices


def is_there(address: Path) -> bool:
    """Whether a world answers at an address."""
    from bracket_sim.process import opening

    return opening.is_there(address)


def drawn_from(address: Path) -> Drawn:
    """What the world at an address was drawn from."""
    from bracket_sim.process import opening

    return opening.drawn_from(address)


def overlapping(product: Product, bench: Bench) -> list[tuple[Location, str]]:
    """Things of a bench that would stand in each other's place."""
    from bracket_sim.scene import storage

    return storage.overlapping(product, bench)


def rendering() -> tuple[str, str]:
    """The OpenGL backend, and how to get it where it does not render."""
    backend = chosen_backend()
    return backend, "" if renders(backend) else remedy(backend)


def schemas() -> Mapping[str, dict[str, Any]]:
    """Schemas of looks, persons and the simulator's settings; a look may stand within the settings."""
    look = _with_ranges(LookFile.model_json_schema())
    settings = Settings.model_json_schema()
    inline = {key: value for key, value in look.items() if key != "$defs"}
    settings["$defs"] |= look["$defs"]
    settings["properties"]["look"]["anyOf"] = [{"type": "string"}, inline]
    return {"look": look, "sim": settings, "person": Person.model_json_schema()}


def _with_ranges(schema: Any) -> Any:
    """The schema of a look file, in which each single value may be a range [from, to]."""
    if isinstance(schema, list):
        return [_with_ranges(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    if schema.get("type") in ("number", "integer", "boolean") or "enum" in schema:
        return {"anyOf": [schema, {"type": "array", "items": schema, "minItems": 2, "maxItems": 2}]}
    return {key: value if key == "default" else _with_ranges(value) for key, value in schema.items()}
