"""Base of all configuration models: unknown keys are errors and values do not change after loading."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Model(BaseModel):
    """A part of a configuration file; field names carry their units."""

    model_config = ConfigDict(extra="forbid", frozen=True)
