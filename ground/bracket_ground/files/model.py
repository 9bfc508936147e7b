"""Base of all configuration models: unknown keys are errors and values do not change after loading."""

from __future__ import annotations

import inspect
import re
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict, field_validator

Location = tuple[str | int, ...]

_ENTRY = re.compile(r"^    (\w+(?:, \w+)*): ")


class Model(BaseModel):
    """A part of a configuration file; field names carry their units, the docstring's Attributes their meaning.

    Attributes:
        moved: keys that older files have here, and what to write instead.
    """

    # Checks are made ready at first use: a process that only gets models, ready made, never needs them.
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, defer_build=True)
    moved: ClassVar[Mapping[str, str]] = {}

    @field_validator("*", mode="before")
    @classmethod
    def _no_null_character(cls, value: Any) -> Any:
        """Operating systems end names at it: what comes behind would be lost."""
        if isinstance(value, str) and "\0" in value:
            raise ValueError("holds a null character")
        return value

    @classmethod
    def summary(cls) -> str:
        """What the docstring says before its Attributes, in one line."""
        return " ".join(inspect.cleandoc(cls.__doc__ or "").partition("Attributes:")[0].split())

    @classmethod
    def meanings(cls) -> dict[str, str]:
        """What the docstring says about each field: the one place that references and schemas are made from."""
        bases = (base for base in cls.__bases__ if issubclass(base, Model) and base is not Model)
        return {name: words for base in bases for name, words in base.meanings().items()} | attributes(cls)

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: Any, handler: Any) -> dict[str, Any]:
        """JSON schema with the docstring's words, so that editors show them."""
        made: dict[str, Any] = handler(core_schema)
        schema = handler.resolve_ref_schema(made)
        schema["description"] = cls.summary()
        for name, meaning in cls.meanings().items():
            if name in schema.get("properties", {}):
                schema["properties"][name]["description"] = meaning
        return made


def attributes(cls: type) -> dict[str, str]:
    """What a class's docstring says about each of its Attributes, in one line each."""
    found: dict[str, str] = {}
    names: list[str] = []
    for line in inspect.cleandoc(cls.__doc__ or "").partition("Attributes:\n")[2].splitlines():
        if entry := _ENTRY.match(line):
            names = entry[1].split(", ")
            found |= dict.fromkeys(names, line[entry.end() :])
        elif names and line.strip():
            found |= {name: f"{found[name]} {line.strip()}" for name in names}
    return found


class Disagreement(ValueError):
    """Parts of a model do not fit together; raised by a model's validator.

    Attributes:
        places: (location within the model, what is wrong there) of every problem.
    """

    def __init__(self, places: Sequence[tuple[Location, str]]) -> None:
        self.places = tuple(places)
        super().__init__("; ".join(what for _, what in places))
