"""`cell data actions|hands|holes|plates|objects`: data from the simulated world, whose labels are true."""

from __future__ import annotations

import gc
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
from cell.errors import InputError

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
LyingOption = Annotated[
    float | None, typer.Option(min=0, max=1, help="With --mixed: share of the parts that lie; 0.2 by default.")
]
ViewsOption = Annotated[int, typer.Option(min=1, max=50, help="Images of each tray.")]
SteelOption = Annotated[float, typer.Option(min=0, max=1, help="Share of recordings with parts of bare steel.")]
ThinOption = Annotated[
    bool, typer.Option("--thin", help="For training: only some of the segments of classes that are frequent.")
]
FramesOption = Annotated[bool, typer.Option("--frames", help="Whole frames of each segment, too, made small.")]
GapsOption = Annotated[
    bool, typer.Option("--gaps", help="The hand as a tracker tells it: lost for a while, or seen elsewhere.")
]
PhysicsOption = Annotated[bool, typer.Option("--physics", help="Move hand and parts by physics: slower, with slips.")]

BesideRobotOption = Annotated[
    bool,
    typer.Option("--beside-robot", help="By physics, and the controller moves the arm beside the person."),
]


class Wanted(NamedTuple):
    """Which data are wanted, and how they are made and told of.

    Attributes:
        person: who assembles; None where nobody does.
    """

    what: str
    out: Path
    look: str
    person: str | None
    recordings: int
    first_seed: int
    config: Path
    as_json: bool
    workers: int
    scheduler: str | None

    def command(self, more: str) -> str:
        """What makes the same data again."""
        person = f" --person {self.person}" if self.person is not None else ""
        seeds = f"--recordings {self.recordings} --first-seed {self.first_seed}"
        return f"cell data {self.what} --look {self.look}{person} {seeds}{more}"


def actions(
    out: OutOption,
    look: LookOption = "varied",
    person: PersonOption = "varied",
    recordings: RecordingsOption = 10,
    first_seed: FirstSeedOption = 0,
    physics: PhysicsOption = False,
    beside_robot: BesideRobotOption = False,
    thin: ThinOption = False,
    frames: FramesOption = False,
    gaps: GapsOption = False,
    steel_share: SteelOption = 0.0,
    workers: WorkersOption = 1,
    scheduler: SchedulerOption = None,
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> None:
    """Segments of 45 frames: the hand's track, a crop of the hand, and what it did."""
    wanted = Wanted("actions", out, look, person, recordings, first_seed, config, as_json, workers, scheduler)
    _from_assemblies(wanted, physics, beside_robot, steel_share, thin=thin, frames=frames, gaps=gaps)


def hands(
    out: OutOption,
    look: LookOption = "varied",
    person: PersonOption = "varied",
    recordings: RecordingsOption = 10,
    first_seed: FirstSeedOption = 0,
    physics: PhysicsOption = False,
    beside_robot: BesideRobotOption = False,
    workers: WorkersOption = 1,
    scheduler: SchedulerOption = None,
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> None:
    """Frames of the overhead camera, and where every hand in them is, with what it holds."""
    wanted = Wanted("hands", out, look, person, recordings, first_seed, config, as_json, workers, scheduler)
    _from_assemblies(wanted, physics, beside_robot)


def holes(
    out: OutOption,
    look: LookOption = "varied",
    person: PersonOption = "varied",
    recordings: RecordingsOption = 10,
    first_seed: FirstSeedOption = 0,
    physics: PhysicsOption = False,
    beside_robot: BesideRobotOption = False,
    steel_share: SteelOption = 0.0,
    workers: WorkersOption = 1,
    scheduler: SchedulerOption = None,
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> None:
    """Crops of the holes, what is in them, and how much of each is hidden."""
    wanted = Wanted("holes", out, look, person, recordings, first_seed, config, as_json, workers, scheduler)
    _from_assemblies(wanted, physics, beside_robot, steel_share)


def plates(
    out: OutOption,
    look: LookOption = "varied",
    person: PersonOption = "varied",
    recordings: Annotated[int, typer.Option(min=1, help="How many looks.")] = 10,
    first_seed: FirstSeedOption = 0,
    stills: Annotated[int, typer.Option(min=1, max=1000, help="Images of each look.")] = 10,
    astray_share: Annotated[
        float, typer.Option(min=0, max=1, help="Of parts, that lie, lean or stand beside their hole.")
    ] = 0.15,
    steel_share: SteelOption = 0.0,
    workers: WorkersOption = 1,
    scheduler: SchedulerOption = None,
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> None:
    """Images of the plate with any parts in its holes and hand or arm over it, and what is in each hole."""
    from cell.configuration import load_configuration, load_product, simulated
    from sim.data.plates import write_plates
    from sim.data.splits import sometimes_steel
    from skills.motion.grasp_pose import tool_down
    from skills.motion.kinematics import Kinematics

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
            astray_share=astray_share,
        )

    wanted = Wanted("plates", out, look, person, recordings, first_seed, config, as_json, workers, scheduler)
    _write(wanted, f" --stills {stills} --astray-share {astray_share}{_steel(steel_share)}", one)


def objects(
    out: OutOption,
    look: LookOption = "varied",
    recordings: RecordingsOption = 10,
    first_seed: FirstSeedOption = 0,
    views: ViewsOption = 1,
    mixed: MixedOption = False,
    lying_share: LyingOption = None,
    steel_share: SteelOption = 0.0,
    workers: WorkersOption = 1,
    scheduler: SchedulerOption = None,
    config: ConfigOption = CONFIGURATION,
    as_json: JsonOption = False,
) -> None:
    """Images of trays from the wrist camera, with type, pose and box of each part."""
    from cell.configuration import load_configuration, load_product, simulated
    from sim.data.objects import write_objects
    from sim.data.splits import LYING_SHARE, mixed_clutter, sometimes_steel

    if lying_share is not None and not mixed:
        raise InputError("--lying-share is for trays of --mixed; in others every part stands as the configuration says")
    lying = LYING_SHARE if lying_share is None else lying_share
    configuration = simulated(load_configuration(config), look)
    product = load_product(configuration, config)
    settings = configuration.devices.simulation

    def one(seed: int, folder: DataFolder) -> None:
        clutter = mixed_clutter(settings.clutter, seed, lying) if mixed else settings.clutter
        simulation = settings.model_copy(update={"clutter": clutter})
        kinds = sometimes_steel(product, steel_share, seed)
        write_objects(kinds, configuration.bench, simulation, seed, folder, views)

    wanted = Wanted("objects", out, look, None, recordings, first_seed, config, as_json, workers, scheduler)
    more = f" --mixed --lying-share {lying}" if mixed else ""
    _write(wanted, f" --views {views}{more}{_steel(steel_share)}", one)


def _from_assemblies(
    wanted: Wanted,
    physics: bool,
    beside_robot: bool,
    steel_share: float = 0.0,
    thin: bool = False,
    frames: bool = False,
    gaps: bool = False,
) -> None:
    from cell.configuration import load_configuration, load_product, simulated
    from sim.data.actions import write_holes, write_segments
    from sim.data.hands import write_hands
    from sim.data.recording import Source, record
    from sim.data.splits import sometimes_steel

    configuration = simulated(load_configuration(wanted.config), wanted.look, wanted.person)
    product, bench = load_product(configuration, wanted.config), configuration.bench
    simulation = configuration.devices.simulation
    writers: dict[str, Callable[[Source, DataFolder], None]] = {
        "actions": partial(write_segments, thin=thin, frames=frames, gaps=gaps),
        "hands": partial(write_hands, every=physics or beside_robot),
        "holes": write_holes,
    }

    def one(seed: int, folder: DataFolder) -> float | None:
        gc.collect()  # what recordings were made of is in cycles: left alone, hundreds of worlds stay, 15 MB each
        kinds = sometimes_steel(product, steel_share, seed)
        if beside_robot:
            from cell.lab.beside_robot import record_beside_robot

            assembly = record_beside_robot(configuration, kinds, seed)
        else:
            assembly = record(kinds, bench, simulation, seed, physics=physics)
        if assembly.world.diverged:
            folder.left_out.append(seed)
            return None
        writers[wanted.what](Source(assembly, kinds, bench), folder)
        return assembly.moments[-1].time_s

    more = " --thin" * thin + " --frames" * frames + " --gaps" * gaps + " --physics" * physics
    more += " --beside-robot" * beside_robot
    _write(wanted, more + _steel(steel_share), one)


def _steel(share: float) -> str:
    return f" --steel-share {share:g}" if share else ""


def _write(wanted: Wanted, more: str, one: Callable[[int, DataFolder], float | None]) -> None:
    from rich.progress import track

    from cell.files.files import whole_folder
    from cell.fleet.engine import mapped
    from sim.data.folder import DataFolder
    from sim.data.splits import seeds

    split, numbers = seeds(wanted.first_seed, wanted.recordings)
    began_s, simulated_s = time.process_time(), 0.0
    with whole_folder(wanted.out) as partial_folder:
        folder = DataFolder(partial_folder, wanted.command(more))
        if wanted.workers == 1 and wanted.scheduler is None:
            lengths = (one(seed, folder) for seed in numbers)
        else:
            pieces = mapped(partial(_piece, one), ((seed,) for seed in numbers), wanted.workers, wanted.scheduler)
            lengths = (_added(folder, *piece) for piece in pieces)
        for length_s in track(lengths, description=wanted.what, console=console(), total=len(numbers)):
            simulated_s += length_s or 0.0
        facts = {"split": split, "first_seed": wanted.first_seed, "recordings": wanted.recordings}
        manifest = folder.close({**facts, "simulated_s": round(simulated_s, 1)})
    spent = {"processor_s": round(time.process_time() - began_s, 1)}
    left_out = {"left out: physics diverged": len(folder.left_out)} if folder.left_out else {}
    console().print(
        table(
            str(wanted.out),
            {"split": split, **manifest["counts"], **left_out, "simulated_s": round(simulated_s, 1), **spent},
        )
    )
    if wanted.as_json:
        print_json({**manifest, **spent})


def _piece(one: Callable[[int, DataFolder], float | None], seed: int) -> tuple[DataPiece, float | None]:
    """What one recording gives, in a worker."""
    from sim.data.folder import DataPiece

    piece = DataPiece()
    return piece, one(seed, piece)


def _added(folder: DataFolder, piece: DataPiece, length_s: float | None) -> float | None:
    folder.add(piece)
    return length_s
