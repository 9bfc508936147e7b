"""`cell data actions|hands|holes|plates|objects`: data from the simulated world, whose labels are true."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, NamedTuple

import typer

from cell.commands.terminal import (
    CONFIGURATION,
    ConfigOption,
    JsonOption,
    SchedulerOption,
    WorkersOption,
    console,
    print_json,
    table,
)

if TYPE_CHECKING:
    from sim.data.folder import DataFolder, DataPiece

OutOption = Annotated[Path, typer.Option("--out", "-o", help="New folder.")]
LookOption = Annotated[str, typer.Option(help="What recordings look like: nominal, varied, hard, or a file.")]
PersonOption = Annotated[str, typer.Option(help="Who assembles: a person's name or file.")]
RecordingsOption = Annotated[int, typer.Option(min=1, help="How many assemblies, or trays for objects.")]
FirstSeedOption = Annotated[
    int, typer.Option(min=0, help="Of seeds in a row: training below 800000, validation below 900000, then tests.")
]
MixedOption = Annotated[bool, typer.Option("--mixed", help="Some parts lie or are stacked, some objects are unknown.")]
ViewsOption = Annotated[int, typer.Option(min=1, max=50, help="Images of each tray.")]
SteelOption = Annotated[float, typer.Option(min=0, max=1, help="Share of recordings with parts of bare steel.")]
ThinOption = Annotated[
    bool, typer.Option("--thin", help="For training: only some of the segments of classes that are frequent.")
]
FramesOption = Annotated[bool, typer.Option("--frames", help="Whole frames of each segment, too, made small.")]
PhysicsOption = Annotated[bool, typer.Option("--physics", help="Move hand and parts by physics: slower, with slips.")]


class Made(NamedTuple):
    """How data are made and told of."""

    as_json: bool
    workers: int
    scheduler: str | None


def actions(
    out: OutOption,
    look: LookOption = "varied",
    person: PersonOption = "varied",
    recordings: RecordingsOption = 10,
    first_seed: FirstSeedOption = 0,
    physics: PhysicsOption = False,
    thin: ThinOption = False,
    frames: FramesOption = False,
    workers: WorkersOption = 1,
    scheduler: SchedulerOption = None,
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> None:
    """Segments of 45 frames: the hand's track, a crop of the hand, and what it did."""
    made = Made(as_json, workers, scheduler)
    _from_assemblies(
        "actions",
        out,
        look,
        person,
        recordings,
        first_seed,
        physics,
        config,
        made,
        thin=thin,
        frames=frames,
    )


def hands(
    out: OutOption,
    look: LookOption = "varied",
    person: PersonOption = "varied",
    recordings: RecordingsOption = 10,
    first_seed: FirstSeedOption = 0,
    physics: PhysicsOption = False,
    workers: WorkersOption = 1,
    scheduler: SchedulerOption = None,
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> None:
    """Frames of the overhead camera, and where every hand in them is, with what it holds."""
    made = Made(as_json, workers, scheduler)
    _from_assemblies("hands", out, look, person, recordings, first_seed, physics, config, made)


def holes(
    out: OutOption,
    look: LookOption = "varied",
    person: PersonOption = "varied",
    recordings: RecordingsOption = 10,
    first_seed: FirstSeedOption = 0,
    physics: PhysicsOption = False,
    steel_share: SteelOption = 0.0,
    workers: WorkersOption = 1,
    scheduler: SchedulerOption = None,
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> None:
    """Crops of the holes, what is in them, and how much of each is hidden."""
    made = Made(as_json, workers, scheduler)
    _from_assemblies(
        "holes",
        out,
        look,
        person,
        recordings,
        first_seed,
        physics,
        config,
        made,
        steel_share,
    )


def plates(
    out: OutOption,
    look: LookOption = "varied",
    person: PersonOption = "varied",
    recordings: Annotated[int, typer.Option(min=1, help="How many looks.")] = 10,
    first_seed: FirstSeedOption = 0,
    stills: Annotated[int, typer.Option(min=1, max=1000, help="Images of each look.")] = 10,
    steel_share: SteelOption = 0.0,
    workers: WorkersOption = 1,
    scheduler: SchedulerOption = None,
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> None:
    """Images of the plate with any parts in its holes and hand or arm over it, and what is in each hole."""
    from cell.configuration import load_configuration, load_product, simulated
    from sim.data.plates import write_plates
    from sim.data.variety import sometimes_steel
    from skills.grasp_pose import tool_down
    from skills.kinematics import Kinematics

    configuration = simulated(load_configuration(config), look, person)
    product = load_product(configuration, config)

    def one(seed: int, folder: DataFolder) -> None:
        kinematics = Kinematics(configuration.motion)
        write_plates(
            sometimes_steel(product, steel_share, seed),
            configuration.bench,
            configuration.devices.simulation,
            seed,
            folder,
            stills,
            lambda tool_m, yaw_rad: kinematics.inverse(tool_down(list(tool_m), yaw_rad)),
        )

    command = f"cell data plates --look {look} --person {person} --recordings {recordings} --first-seed {first_seed}"
    command += f" --stills {stills}" + (f" --steel-share {steel_share:g}" if steel_share else "")
    _write(command, (out, recordings, first_seed), Made(as_json, workers, scheduler), one)


def objects(
    out: OutOption,
    look: LookOption = "varied",
    recordings: RecordingsOption = 10,
    first_seed: FirstSeedOption = 0,
    views: ViewsOption = 1,
    mixed: MixedOption = False,
    steel_share: SteelOption = 0.0,
    workers: WorkersOption = 1,
    scheduler: SchedulerOption = None,
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> None:
    """Images of trays from the wrist camera, with type, pose and box of each part."""
    from cell.configuration import load_configuration, load_product, simulated
    from sim.data.objects import write_objects
    from sim.data.variety import mixed_clutter, sometimes_steel

    configuration = simulated(load_configuration(config), look)
    product = load_product(configuration, config)
    settings = configuration.devices.simulation

    def one(seed: int, folder: DataFolder) -> None:
        clutter = mixed_clutter(settings.clutter, seed) if mixed else settings.clutter
        simulation = settings.model_copy(update={"clutter": clutter})
        kinds = sometimes_steel(product, steel_share, seed)
        write_objects(kinds, configuration.bench, simulation, seed, folder, views)

    command = f"cell data objects --look {look} --recordings {recordings} --first-seed {first_seed} --views {views}"
    command += " --mixed" * mixed + (f" --steel-share {steel_share:g}" if steel_share else "")
    _write(command, (out, recordings, first_seed), Made(as_json, workers, scheduler), one)


def _from_assemblies(
    what: str,
    out: Path,
    look: str,
    person: str,
    recordings: int,
    first_seed: int,
    physics: bool,
    config: Path,
    made: Made,
    steel_share: float = 0.0,
    thin: bool = False,
    frames: bool = False,
) -> None:
    from cell.configuration import load_configuration, load_product, simulated
    from sim.data.actions import Source, write_holes, write_segments
    from sim.data.hands import write_hands
    from sim.data.recording import record
    from sim.data.variety import sometimes_steel

    configuration = simulated(load_configuration(config), look, person)
    product, bench = load_product(configuration, config), configuration.bench
    simulation = configuration.devices.simulation
    writers: dict[str, Callable[[Source, DataFolder], None]] = {
        "actions": partial(write_segments, thin=thin, frames=frames),
        "hands": partial(write_hands, every=physics),
        "holes": write_holes,
    }

    def one(seed: int, folder: DataFolder) -> float:
        kinds = sometimes_steel(product, steel_share, seed)
        assembly = record(kinds, bench, simulation, seed, physics=physics)
        writers[what](Source(assembly, kinds, bench), folder)
        return assembly.moments[-1].time_s

    command = f"cell data {what} --look {look} --person {person} --recordings {recordings} --first-seed {first_seed}"
    command += " --thin" * thin + " --frames" * frames + " --physics" * physics
    command += f" --steel-share {steel_share:g}" if steel_share else ""
    _write(command, (out, recordings, first_seed), made, one)


def _write(
    command: str, options: tuple[Path, int, int], made: Made, one: Callable[[int, DataFolder], float | None]
) -> None:
    from rich.progress import track

    from cell.fleet.engine import mapped
    from sim.data.folder import DataFolder
    from sim.data.splits import seeds

    out, recordings, first_seed = options
    split, wanted = seeds(first_seed, recordings)
    folder = DataFolder(out, command)
    began_s, simulated_s = time.process_time(), 0.0
    if made.workers == 1 and made.scheduler is None:
        lengths = (one(seed, folder) for seed in wanted)
    else:
        pieces = mapped(partial(_piece, one), ((seed,) for seed in wanted), made.workers, made.scheduler)
        lengths = (_added(folder, *piece) for piece in pieces)
    for length_s in track(lengths, description=command.split()[2], console=console(), total=len(wanted)):
        simulated_s += length_s or 0.0
    facts = {"split": split, "first_seed": first_seed, "recordings": recordings}
    manifest = folder.close({**facts, "simulated_s": round(simulated_s, 1)})
    spent = {"processor_s": round(time.process_time() - began_s, 1)}
    console().print(
        table(str(out), {"split": split, **manifest["counts"], "simulated_s": round(simulated_s, 1), **spent})
    )
    if made.as_json:
        print_json({**manifest, **spent})


def _piece(one: Callable[[int, DataFolder], float | None], seed: int) -> tuple[DataPiece, float | None]:
    """What one recording gives, in a worker."""
    from sim.data.folder import DataPiece

    piece = DataPiece()
    return piece, one(seed, piece)


def _added(folder: DataFolder, piece: DataPiece, length_s: float | None) -> float | None:
    folder.add(piece)
    return length_s
