"""Sub-assemblies: types of part that are built beside from others, from the bottom up, and put in whole."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from bracket_ground.files.model import Location

if TYPE_CHECKING:
    from bracket_ground.interfaces.product import PartType, Product

MADE_OF = "made_of"


def with_wholes(file: dict[str, Any], read: type[PartType], context: Any) -> dict[str, Any]:
    """A product file's content in which each sub-assembly has the shape of its parts; what cannot be stays as it is.

    Args:
        read: reads a type of part.
        context: of the file that is read.
    """
    parts = file.get("parts")
    if not isinstance(parts, dict):
        return file
    found = {}
    for name, part in parts.items():
        names = part.get(MADE_OF) if isinstance(part, dict) and "size_m" not in part else None
        entries = [parts.get(key) for key in names if isinstance(key, str)] if isinstance(names, list | tuple) else []
        plain = [entry for entry in entries if isinstance(entry, dict) and not entry.get(MADE_OF)]
        if not plain:
            continue
        try:
            found[name] = {**_stacked([read.model_validate(entry, context=context) for entry in plain]), **part}
        except ValidationError:  # the entry of the part says what is wrong
            continue
    return {**file, "parts": {**parts, **found}}


def _stacked(kinds: list[PartType]) -> dict[str, Any]:
    """Size, shape and mass of parts on top of each other; the camera above sees the uppermost."""
    height_m, solids = 0.0, []
    for kind in kinds:
        solids += [solid.raised(height_m) for solid in kind.solids]
        height_m += kind.size_m[2]
    low, top = kinds[0], kinds[-1]
    return {
        "size_m": (max(kind.size_m[0] for kind in kinds), max(kind.size_m[1] for kind in kinds), height_m),
        "peg_diameter_m": low.peg_diameter_m,
        "peg_length_m": low.peg_length_m,
        "colour_rgb": top.colour_rgb,
        "finish": top.finish,
        "mass_kg": sum(kind.mass_kg for kind in kinds),
        "shape": solids,
    }


def unfit_wholes(product: Product) -> Iterator[tuple[Location, str]]:
    """Sub-assemblies that cannot be built, and where the file says so."""
    for name, kind in product.parts.items():
        at: Location = ("parts", name, MADE_OF)
        plain = ", ".join(part for part, other in product.parts.items() if not other.made_of)
        if not kind.made_of:
            if kind.built_at:
                yield ("parts", name, "built_at"), "it is built at a place, but made_of does not say of which parts"
            continue
        if len(kind.made_of) < 2:
            yield at, "a sub-assembly is made of two parts or more, from the bottom up"
        if (twin := next(whole for whole, other in product.wholes.items() if other.made_of == kind.made_of)) != name:
            yield at, f"is that of {twin}, too: nobody could tell which of them was built"
        if not kind.built_at:
            yield ("parts", name), f"built_at is missing: the place of the bench where {name} is built"
        for part in dict.fromkeys(kind.made_of):
            if part not in product.parts or product.parts[part].made_of:
                yield at, f"{part!r} is no single part; legal: {plain}"
            elif product.most[part]:
                yield at, f"a goal takes {part} by itself, too; give the part of the sub-assembly a type of its own"


def parts_of_wholes(parts: Mapping[str, Mapping[str, Any]], most: Mapping[str, int]) -> Iterator[tuple[str, int]]:
    """How many of each type the sub-assemblies of a product file take.

    Args:
        most: of each type, how many the goals take; a `quantity` of the file counts more.
    """
    for name, part in parts.items():
        for piece in part.get(MADE_OF, ()):
            yield piece, int(part.get("quantity", most.get(name, 0)))
