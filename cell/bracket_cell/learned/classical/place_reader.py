"""Reads what stands at places of the bench that the overhead camera sees, as holes of a bracket are read."""

from __future__ import annotations

from collections.abc import Mapping

from bracket_cell.learned.classical.colour import ColourModel
from bracket_cell.learned.classical.hole_reader import ClassicalHoleReader
from bracket_cell.learned.classical.settings import PerceptionSettings
from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.frame import Frame
from bracket_ground.interfaces.perception import HandSample, HoleView
from bracket_ground.interfaces.places import BenchPlace, Mount, spot_name
from bracket_ground.interfaces.product import Product


class PlaceReader:
    """What stands at each spot of the places that are `seen`; each place is a plate with a hole for each spot."""

    def __init__(self, bench: Bench, product: Product, settings: PerceptionSettings) -> None:
        seen = {name: place for name, place in bench.places.items() if place.known_by == "seen"}
        colours = ColourModel(product, settings.skin_rgb) if seen else None
        self._readers = [
            ClassicalHoleReader(_standing_at(bench, place), _as_plate(product, name, place), settings, colours)
            for name, place in seen.items()
            if colours is not None
        ]

    def read(self, frame: Frame, hand: HandSample | None) -> Mapping[str, HoleView]:
        """By name of the spot, as far as ever seen unobstructed."""
        return {name: view for reader in self._readers for name, view in reader.read(frame, hand).items()}


def _standing_at(bench: Bench, place: BenchPlace) -> Bench:
    """The bench as if its bracket were the place."""
    mount = Mount(position_m=place.position_m, quaternion_wxyz=place.quaternion_wxyz)
    return bench.model_copy(update={"bracket": mount})


def _as_plate(product: Product, name: str, place: BenchPlace) -> Product:
    """A product whose bracket has the spots of a place for holes; types stay in their order, as colours know them."""
    held = [part for part in product.parts if place.takes(part)]
    parts = {
        part: {**kind.model_dump(exclude={"quantity"}), **({} if part in held else {"quantity": 0})}
        for part, kind in product.parts.items()
    }
    holes = {spot_name(name, number): at for number, at in enumerate(place.spots_m)}
    plate = {**product.bracket.model_dump(exclude={"plates"}), "holes_m": holes}
    goals = {"any": {next(iter(holes)): held}}
    return Product.model_validate({"name": name, "parts": parts, "bracket": plate, "goals": goals})
