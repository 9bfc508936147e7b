"""`cell safety`: the configuration that decides on people, shown and signed by a person."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from bracket_cell.commands.options import CONFIGURATION, ConfigOption, JsonOption
from bracket_cell.commands.terminal import console, print_json
from bracket_ground.errors import InputError

safety_app = typer.Typer(no_args_is_help=True, help="Show and sign what decides on people.")


@safety_app.command()
def show(config: ConfigOption = CONFIGURATION, as_json: JsonOption = False) -> int:
    """Show all values, their hash, who signed it and what changed since; status 1 where it is not signed as it is."""
    from bracket_cell.runs.signing import signature_of
    from bracket_cell.wiring.safety import safety_from

    safety, signature = safety_from(config), signature_of(config)
    changes = [] if signature is None else safety.changes(signature.values)
    if as_json:
        signed = None if signature is None else signature.model_dump(include={"by", "utc", "sha256"})
        print_json({"sha256": safety.sha256, "signed": signed, "changes": changes, "values": dict(safety.values)})
    else:
        sys.stdout.writelines(f"{key}: {value}\n" for key, value in safety.values.items())
        state = "not signed" if signature is None else f"last signature: {signature}"
        sys.stdout.writelines(f"{line}\n" for line in (f"safety configuration {safety.short}", state, *changes))
    return 1 if signature is None or changes else 0


@safety_app.command()
def sign(
    by: Annotated[str, typer.Option("--by", help="Who signs.")],
    config: ConfigOption = CONFIGURATION,
    hash_: Annotated[
        str | None, typer.Option("--hash", help="First digits of the hash, as shown; asked for where it is left out.")
    ] = None,
) -> int:
    """Sign the safety configuration as it is now. It says first what changed since the last signature."""
    from bracket_cell.runs.signing import sign as write_signature
    from bracket_cell.runs.signing import signature_file, signature_of
    from bracket_cell.wiring.safety import safety_from

    if not by.strip():
        raise InputError("--by names nobody: say who signs")
    safety, before = safety_from(config), signature_of(config)
    changes = [] if before is None else safety.changes(before.values)
    if before is not None and not changes:
        console().print(f"nothing changed since {before}", highlight=False)
        return 0
    last = "nobody signed before: `cell safety show` lists what is signed" if before is None else f"last: {before}"
    for line in (last, *changes, f"safety configuration {safety.short}"):
        console().print(line, highlight=False)
    _require_hash(safety.sha256, _asked() if hash_ is None else hash_)
    signature = write_signature(config, safety, by.strip())
    console().print(f"{signature_file(config)}: {signature}", highlight=False)
    return 0


def _asked() -> str:
    """What the person types; raises InputError where nobody can."""
    console().print("type the first 8 digits of the hash to sign it:", highlight=False)
    if not (typed := sys.stdin.readline()):
        raise InputError("nobody typed the hash: name it with --hash; nothing was signed")
    return typed.strip()


def _require_hash(sha256: str, typed: str) -> None:
    """Check that a person compared the hash; raises InputError otherwise."""
    if len(typed) < 8 or not sha256.startswith(typed.lower()):
        raise InputError(f"{typed!r} does not begin the hash {sha256[:12]} with 8 digits or more; nothing was signed")
