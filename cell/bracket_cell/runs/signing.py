"""Who signed a safety configuration: a file beside the cell's configuration, which keeps the values that were signed.

It is no seal: whoever can write the file can sign. It shows that a person looked at these values, and what has become
another one since.
"""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import yaml
from pydantic import Field, model_validator

from bracket_cell.wiring.devices import Driver
from bracket_cell.wiring.safety import SHORT, SafetyConfiguration, hash_of
from bracket_ground.errors import InputError, Place, Problem
from bracket_ground.files.files import write_whole
from bracket_ground.files.model import Disagreement, Model
from bracket_ground.files.yaml_file import load_yaml

HEAD = "# Written by `cell safety sign`; a run on real devices refuses other values (docs/safety.md).\n"
MOVING = ("arm", "gripper")


class Signed(Model):
    """One signature.

    Attributes:
        by: who signed.
        utc: when, as ISO 8601.
        sha256: of the safety configuration.
    """

    by: str = Field(min_length=1, max_length=100, pattern=r"\S")
    utc: str
    sha256: str

    def __str__(self) -> str:
        return f"{self.sha256[:SHORT]}, signed by {self.by}, {self.utc}"


class Signature(Signed):
    """The newest signature.

    Attributes:
        earlier: the signatures before it, the newest first.
        values: the safety configuration that was signed.
    """

    earlier: tuple[Signed, ...] = ()
    values: dict[str, Any]

    @model_validator(mode="after")
    def _of_these_values(self) -> Signature:
        if hash_of(self.values) != self.sha256:
            raise Disagreement([(("sha256",), "is not the hash of the values here: somebody edited this file")])
        return self


def signature_file(configuration: Path) -> Path:
    """Where the signature of a configuration is kept: cell.signed.yaml beside cell.yaml."""
    return configuration.with_name(f"{configuration.stem}.signed.yaml")


def signature_of(configuration: Path) -> Signature | None:
    """Who signed last; None where nobody did.

    Raises:
        InputError: the file cannot be read, or was edited.
    """
    path = signature_file(configuration)
    return load_yaml(path, Signature) if path.exists() else None


def sign(configuration: Path, safety: SafetyConfiguration, by: str) -> Signature:
    """Sign, and keep who signed before.

    Raises:
        InputError: the file cannot be written, or the one that is there was edited.
    """
    before = signature_of(configuration)
    earlier = () if before is None else (Signed(by=before.by, utc=before.utc, sha256=before.sha256), *before.earlier)
    utc = datetime.now(UTC).isoformat(timespec="seconds")
    signature = Signature(by=by, utc=utc, sha256=safety.sha256, earlier=earlier, values=dict(safety.values))
    text = yaml.safe_dump(signature.model_dump(mode="json"), sort_keys=False, allow_unicode=True, width=1000)
    write_whole(signature_file(configuration), (HEAD + text).encode())
    return signature


def moves_something(drivers: Iterable[Driver]) -> bool:
    """Whether a real arm or gripper is among these drivers."""
    return any(driver.on_the_wall for driver in drivers if driver.role in MOVING)


def required_signature(configuration: Path, safety: SafetyConfiguration) -> Signature:
    """The signature of exactly this safety configuration.

    Raises:
        InputError: nobody signed it; with every value that has become another one since the last signature.
    """
    signature, path = signature_of(configuration), signature_file(configuration)
    way = (
        f"read `cell safety show --config {configuration}`, then `cell safety sign --config {configuration} --by NAME`"
    )
    if signature is None:
        what = f"nobody signed the safety configuration {safety.short}, which a run on real devices needs"
        raise InputError(Problem(Place(configuration), what, way))
    if changes := safety.changes(signature.values):
        what = f"the safety configuration is {safety.short} now, another one than {signature}; nothing moved"
        raise InputError(Problem(Place(path), what, way), *changes)
    return signature
