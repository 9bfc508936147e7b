"""`cell setup calibrate`: where the cameras really hang, into a file that the configuration names."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
import yaml

from bracket_cell.commands.options import (
    CONFIGURATION,
    OUT_HELP,
    ConfigOption,
    JsonOption,
    OverwriteOption,
    SeedOption,
    SlowerOption,
    folder_for,
    told_in,
    writable,
)
from bracket_cell.commands.terminal import console, print_json, table
from bracket_cell.configuration import CALIBRATION, load_configuration, load_product, simulated
from bracket_cell.runs.calibrating import Calibrated, stamped_delays_s
from bracket_cell.runs.calibrating import calibrate as calibration_of
from bracket_cell.runs.options import LOOK_HELP
from bracket_ground.errors import InputError
from bracket_ground.files.files import whole_or_none
from bracket_ground.files.yaml_file import load_yaml, write_values
from bracket_ground.interfaces.bench import Calibration

PERSON = "absent"  # in a simulation; at a real bench, whoever types this sees to it


def calibrate(
    out: Annotated[Path | None, typer.Option("--out", "-o", help=OUT_HELP)] = None,
    config: ConfigOption = CONFIGURATION,
    seed: SeedOption = 0,
    look: Annotated[str | None, typer.Option(help=LOOK_HELP)] = None,
    overhead_only: Annotated[
        bool,
        typer.Option(
            "--overhead-only",
            help="Calibrate only the overhead camera: nothing moves, and the file's wrist camera is kept.",
        ),
    ] = False,
    overwrite: OverwriteOption = False,
    slower: SlowerOption = 1.0,
    as_json: JsonOption = False,
) -> int:
    """Calibrate the cameras: find out where they hang. The arm moves over the empty bracket: keep away from it.

    By default calibration.yaml next to the configuration is written.
    """
    path = out or folder_for(config) / CALIBRATION
    if path.exists() and not overwrite:
        raise InputError(f"{path}: exists already; choose another --out, or add --overwrite")
    writable(path, ".yaml", ".yml")
    wrist = load_yaml(path, Calibration).wrist if overhead_only and path.exists() else None
    configuration = simulated(load_configuration(config), look, PERSON)
    product = load_product(configuration, config)
    say = console().print
    say("keep away: the arm moves over the bracket" if not overhead_only else "overhead camera")
    found, cameras, delays_s = calibration_of(
        configuration, product, seed, overhead_only, lambda text: say(text, highlight=False), slower
    )
    say(table("cameras", {name: one.trouble or _words(one) for name, one in cameras.items()}))
    for role in stamped_delays_s(configuration) if cameras.keys() >= {"wrist"} else ():
        told = f"{1e3 * delays_s[role]:.0f} ms" if role in delays_s else "not seen: is the arm in view?"
        say(f"delay of camera {role}: {told}", highlight=False)
    if as_json:
        every = {name: one.told() for name, one in cameras.items()}
        print_json({"file": str(path), "good": found is not None, **every, "delays_s": delays_s})
    if found is None:
        say("nothing was written")
        return 1
    if delays_s:
        write_values(config, {("devices", role, "delay_s"): delay_s for role, delay_s in delays_s.items()})
    _write(found.model_copy(update={"wrist": wrist}) if overhead_only else found, path)
    say(f"{path}: to use it, in {config}: calibration: {told_in(config, path)}", highlight=False)
    return 0


def _words(one: Calibrated) -> str:
    fit = one.fit
    off = f"{1e3 * one.off_m:.1f} mm off by the bench file, fit {fit.rms_px:.2f} px"
    return f"{off}, {fit.edges} points of edges, {fit.holes} holes, {fit.images} images"


def _write(found: Calibration, path: Path) -> None:

    told = found.model_dump(mode="json", exclude_none=True)
    text = "# Where the cameras hang and how they see; made by: cell setup calibrate\n" + yaml.safe_dump(
        told, sort_keys=False
    )
    try:
        with whole_or_none(path) as partial:
            partial.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None
