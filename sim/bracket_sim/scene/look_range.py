"""Ranges of looks: presets and look files, and the drawing of one run's look from its seed.

A look file has the shape of a `Look` in which a list of two values, [from, to], may stand for any value. What it leaves
out is as in its `base`, a preset. The preset `nominal` is that of today's figures, `varied` what
detectors are trained on, and `hard` lies outside `varied`.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import BeforeValidator, ValidationError, ValidationInfo, WithJsonSchema, field_validator, model_validator
from pydantic_core import InitErrorDetails

from bracket_ground.errors import InputError
from bracket_ground.files.files import shipped
from bracket_ground.files.model import Disagreement, Location, Model
from bracket_ground.files.yaml_file import load_yaml
from bracket_sim.scene.look import NOMINAL, Look

FOLDER = shipped("bracket_cell.config", "looks")
STREAM = 0x4C4F4F4B  # of random numbers: the looks' own, so that the rest of a run is the same under every look
BASE = "nominal"


class LookFile(Look):
    """What a run looks like. Each value may also be a range, written [from, to], that the seed draws from.

    Attributes:
        base: preset that says what this file does not.
    """

    base: str = BASE

    @field_validator("base")
    @classmethod
    def _is_a_preset(cls, base: str) -> str:
        if base not in presets():
            raise ValueError(f"no such preset; legal: {', '.join(presets())}")
        return base


class LookRange(Model):
    """All looks between two: every value lies between those of `low` and `high`.

    In a file it is written as a `LookFile` with ranges.

    Attributes:
        name: of the preset or file.
        low, high: the ends of all ranges.
    """

    written_as: ClassVar[type[Model]] = LookFile

    name: str = BASE
    low: Look = NOMINAL
    high: Look = NOMINAL

    @model_validator(mode="before")
    @classmethod
    def _read(cls, data: Any) -> Any:
        if not isinstance(data, Mapping) or data.keys() <= cls.model_fields.keys():
            return data
        named = data.get("base", BASE)
        base = look_range(named if named in presets() else BASE)
        ends = [_merged(end.model_dump(), _end(data, side)) for side, end in enumerate((base.low, base.high))]
        low, high = _checked(ends)
        return {"name": "inline", "low": _plain(low), "high": _plain(high)}

    @model_validator(mode="after")
    def _ranges_run_upwards(self) -> LookRange:
        backwards = [
            (location, f"the range from {low} to {high} runs backwards")
            for location, low, high in leaves(self.low.model_dump(), self.high.model_dump())
            if high < low
        ]
        if backwards:
            raise Disagreement(backwards)
        return self

    def fixed(self, place: str, value: object) -> LookRange:
        """The same looks, with one value that is the same in all of them.

        Args:
            place: section and field with a dot between, as in "light.ambient".

        Raises:
            InputError: there is no such value, or it is not legal.
        """
        ends = [end.model_dump() for end in (self.low, self.high)]
        legal = {".".join(map(str, location)) for location, _, _ in leaves(ends[0], ends[1])}
        if place not in legal:
            near = sorted(name for name in legal if name.partition(".")[0] == place.partition(".")[0])
            raise InputError(f"a look has no value {place!r}; legal: {', '.join(near or sorted(legal))}")
        try:
            low, high = (Look.model_validate(_with(end, place.split("."), value)) for end in ends)
        except ValidationError as error:
            raise InputError(f"{place} of a look: {error.errors()[0]['msg']}, not {value!r}") from None
        return LookRange(name=f"{self.name}, {place} {value}", low=low, high=high)

    def draw(self, seed: int) -> Look:
        """The look of one run.

        Each value has a random stream of its own, named by its place: a value that is fixed, or a knob that is new,
        changes no other. Numbers are drawn evenly, yes or no by a fair coin.
        """
        return Look.model_validate(_drawn(seed, (), self.low.model_dump(), self.high.model_dump()))


def look_range(name: str, folder: Path = Path()) -> LookRange:
    """A preset, or the look file of that name; a colon and a section takes that section alone, as in "hard:light".

    Args:
        folder: where files are looked for.

    Raises:
        InputError: there is no such preset, file or section, or the file is wrong.
    """
    if not (folder / name).is_file() and ":" in name:
        name, _, section = name.rpartition(":")
        return _section(look_range(name, folder), section)
    if name == BASE:
        return LookRange(name=BASE)
    path = FOLDER / f"{name}.yaml" if name in presets() else folder / name
    if not path.is_file():
        raise InputError(f"no look {name!r}; legal: {', '.join(presets())}, each also as NAME:SECTION, or a look file")
    return load_yaml(path, LookRange).model_copy(update={"name": name})


def _named(value: Any, info: ValidationInfo) -> Any:
    if not isinstance(value, str):
        return value
    return look_range(value, Path((info.context or {}).get("folder", ".")))


NamedLook = Annotated[
    LookRange, BeforeValidator(_named), WithJsonSchema({"anyOf": [{"type": "string"}, {"type": "object"}]})
]


def presets() -> list[str]:
    """Names of the looks that are shipped."""
    return [BASE, *sorted(path.stem for path in FOLDER.glob("*.yaml"))]


def leaves(low: Any, high: Any, location: Location = ()) -> Iterator[tuple[Location, Any, Any]]:
    """(place, value in the one, value in the other) of all single values of two looks' dumps."""
    steps = _steps(low)
    if steps is None:
        yield location, low, high
        return
    for step in steps:
        yield from leaves(low[step], high[step], (*location, step))


def _section(looks: LookRange, section: str) -> LookRange:
    if section not in Look.model_fields:
        raise InputError(f"a look has no section {section!r}; legal: {', '.join(Look.model_fields)}")
    low, high = (NOMINAL.model_copy(update={section: getattr(end, section)}) for end in (looks.low, looks.high))
    return LookRange(name=f"{looks.name}:{section}", low=low, high=high)


def _drawn(seed: int, location: Location, low: Any, high: Any) -> Any:
    if isinstance(low, Mapping):
        return {step: _drawn(seed, (*location, step), low[step], high[step]) for step in low}
    if isinstance(low, list | tuple):
        return [_drawn(seed, (*location, step), low[step], high[step]) for step in range(len(low))]
    if low == high:
        return low
    name = zlib.crc32(".".join(map(str, location)).encode())
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(STREAM, name)))
    if isinstance(low, bool):
        return bool(rng.integers(2))
    if isinstance(low, str):
        return (low, high)[int(rng.integers(2))]
    if isinstance(low, int):
        return int(rng.integers(low, high, endpoint=True))
    return float(rng.uniform(low, high))


def _with(look: Any, steps: Sequence[str], value: object) -> Any:
    """A look's dump with one value changed."""
    if not steps:
        return value
    if isinstance(look, Mapping):
        return {**look, steps[0]: _with(look[steps[0]], steps[1:], value)}
    return [_with(item, steps[1:], value) if str(index) == steps[0] else item for index, item in enumerate(look)]


def _end(data: Any, side: int) -> Any:
    """One end of every range; what is no range is itself."""
    if isinstance(data, Mapping):
        return {key: _end(value, side) for key, value in data.items()}
    if not isinstance(data, list):
        return data
    if len(data) == 2 and not any(isinstance(item, list | Mapping) for item in data):
        return data[side]
    return [_end(item, side) for item in data]


def _checked(ends: Sequence[Any]) -> list[LookFile]:
    """Both ends of all ranges. Raises ValidationError with the problems of both, each once."""
    made: list[LookFile] = []
    problems: dict[tuple[Any, ...], InitErrorDetails] = {}
    for end in ends:
        try:
            made.append(LookFile.model_validate(end))
        except ValidationError as error:
            for typed_dict_type in error.errors(include_url=False):
                details = InitErrorDetails(
                    type=typed_dict_type["type"],
                    loc=typed_dict_type["loc"],
                    input=typed_dict_type["input"],
                    ctx=typed_dict_type.get("ctx", {}),
                )
                problems.setdefault((typed_dict_type["loc"], typed_dict_type["type"]), details)
    if problems:
        raise ValidationError.from_exception_data("look", list(problems.values()))
    return made


def _merged(base: Any, change: Any) -> Any:
    """`base` with what `change` says; lists of mappings are merged item by item."""
    if isinstance(base, Mapping) and isinstance(change, Mapping):
        return {**base, **{key: _merged(base.get(key), value) for key, value in change.items()}}
    if isinstance(base, list | tuple) and isinstance(change, list) and len(base) == len(change):
        return [_merged(before, after) for before, after in zip(base, change, strict=True)]
    return change


def _steps(value: Any) -> list[Any] | None:
    if isinstance(value, Mapping):
        return list(value)
    return list(range(len(value))) if isinstance(value, list | tuple) else None


def _plain(look: LookFile) -> Look:
    return Look.model_validate(look.model_dump(exclude={"base"}))
