"""Data from the simulated world, whose labels are true: a record for each data set, and what makes it."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.progress import track
from typer import Option

from bracket_cell.commands.options import (
    CONFIGURATION,
    ConfigOption,
    JsonOption,
    LookOption,
    PersonOption,
    SchedulerOption,
    SeedsOption,
    WorkersOption,
    command_from,
    seeds_of,
)
from bracket_cell.commands.terminal import console, print_json, table
from bracket_cell.configuration import Configuration, load_configuration, load_product, simulated
from bracket_cell.fleet.engine import mapped
from bracket_cell.kinds import DETECTORS
from bracket_cell.skills.motion.grasp_pose import tool_down
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.wiring.detectors import Detectors
from bracket_ground.errors import InputError
from bracket_ground.files.data_folder import DataFolder, DataPiece
from bracket_ground.files.files import whole_folder
from bracket_ground.interfaces.perception import HandTracker
from bracket_ground.interfaces.product import Product
from bracket_lab.drawing import actions, hands, objects, plates, recording
from bracket_lab.drawing.sight import (
    LYING_SHARE,
    STACKED_SHARE,
    mixed_clutter,
    seeds,
    sometimes_steel,
    true_calibration,
)
from bracket_sim.scene.settings import settings_of

One = Callable[[int, DataFolder], float | None]  # makes what one seed gives; returns the simulated seconds
Film = Callable[[Configuration, Product, int], recording.Assembly]
_WORK = ("person", "physics", "beside_robot")
TRACKERS = tuple(DETECTORS["hands"])


@dataclass(frozen=True, kw_only=True)
class Data:
    """Which data are wanted, and how they are made."""

    out: Annotated[Path, Option("--out", "-o", help="New folder.")]
    look: LookOption = "varied"
    person: PersonOption = "varied"
    seeds: SeedsOption = "0:10"
    physics: Annotated[bool, Option("--physics", help="Move hand and parts by physics: slower, with slips.")] = False
    beside_robot: Annotated[
        bool, Option("--beside-robot", help="By physics, and the controller moves the arm next to the person.")
    ] = False
    thin: Annotated[bool, Option("--thin", help="For training: leave out most segments of frequent classes.")] = False
    frames: Annotated[bool, Option("--frames", help="Add whole frames of each segment, made small.")] = False
    gaps: Annotated[bool, Option("--gaps", help="The hand as a tracker reports it: lost at times, or elsewhere.")] = (
        False
    )
    tracker: Annotated[
        str | None, Option(help=f"The hand as this tracker sees it in every frame: {', '.join(TRACKERS)}; slower.")
    ] = None
    stills: Annotated[int, Option(min=1, max=1000, help="Images of each look.")] = 10
    astray_share: Annotated[
        float, Option(min=0, max=1, help="Share of the parts that lie, lean or stand next to their hole.")
    ] = 0.15
    views: Annotated[int, Option(min=1, max=50, help="Images of each tray.")] = 1
    mixed: Annotated[bool, Option("--mixed", help="Some parts lie or are stacked, and some objects are unknown.")] = (
        False
    )
    lying_share: Annotated[
        float | None, Option(min=0, max=1, help=f"With --mixed: share of the parts that lie; {LYING_SHARE} by default.")
    ] = None
    stacked_share: Annotated[
        float | None,
        Option(min=0, max=1, help=f"With --mixed: share of the parts on top of others; {STACKED_SHARE} by default."),
    ] = None
    steel_share: Annotated[float, Option(min=0, max=1, help="Share of recordings with parts of bare steel.")] = 0.0
    workers: WorkersOption = 1
    scheduler: SchedulerOption = None
    config: ConfigOption = CONFIGURATION
    as_json: JsonOption = False

    def cell(self) -> tuple[Configuration, Product]:
        """The configuration, simulated as it is wanted, and its product."""
        configuration = simulated(load_configuration(self.config), self.look, self.person)
        return configuration, load_product(configuration, self.config)


@dataclass(frozen=True)
class DataSet:
    """A kind of data.

    Attributes:
        help: what it holds.
        options: of Data, besides those that all have.
        maker: gives what makes the data of one seed.
    """

    help: str
    options: tuple[str, ...]
    maker: Callable[[Data, Film | None], One]
    common: tuple[str, ...] = ("out", "look", "seeds", "steel_share", "workers", "scheduler", "config", "as_json")


def _assemblies(write: Callable[..., None], *names: str) -> Callable[[Data, Film | None], One]:
    """Makes data of recorded assemblies.

    Args:
        names: options that `write` takes by the same name.
    """

    def maker(asked: Data, film: Film | None) -> One:
        configuration, product = asked.cell()
        bench, simulation = configuration.bench, settings_of(configuration.devices.simulation)
        more: dict[str, Any] = {name: getattr(asked, name) for name in names if name != "tracker"}
        follow = None if asked.tracker is None else _tracking(asked.tracker, configuration)
        if write is hands.write_hands:
            more["every"] = asked.physics or asked.beside_robot

        def one(seed: int, folder: DataFolder) -> float | None:
            gc.collect()  # what recordings were made of is in cycles: left alone, hundreds of worlds stay, 15 MB each
            kinds = sometimes_steel(product, asked.steel_share, seed)
            if asked.beside_robot and film is not None:
                assembly = film(configuration, kinds, seed)
            else:
                assembly = recording.record(kinds, bench, simulation, seed, physics=asked.physics)
            if assembly.world.diverged:
                folder.left_out.append(seed)
                return None
            seen = {} if follow is None else {"tracker": follow(kinds, assembly)}
            write(recording.Source(assembly, kinds, bench), folder, **more, **seen)
            return assembly.moments[-1].time_s

        return one

    return maker


def _tracking(kind: str, configuration: Configuration) -> Callable[[Product, recording.Assembly], HandTracker]:
    """Makes trackers of a kind, each for the camera as it hangs in the look of a recording.

    Raises:
        InputError: there is no such kind.
    """
    if kind not in TRACKERS:
        raise InputError(f"--tracker {kind}: unknown kind; legal: {', '.join(TRACKERS)}")
    perception = configuration.perception.with_detector("hands", kind)

    def follow(product: Product, assembly: recording.Assembly) -> HandTracker:
        drawn = configuration.bench
        overhead = drawn.overhead.calibrated(true_calibration(assembly.world, "overhead", drawn.overhead))
        bench = drawn.model_copy(update={"overhead": overhead})
        tracker: HandTracker = Detectors(bench, product, perception).make("hands")
        return tracker

    return follow


def _plates(asked: Data, _: Film | None) -> One:
    configuration, product = asked.cell()

    def one(seed: int, folder: DataFolder) -> None:
        kinematics = Kinematics(configuration.motion)
        plates.write_plates(
            sometimes_steel(product, asked.steel_share, seed),
            configuration.bench,
            settings_of(configuration.devices.simulation),
            seed,
            folder,
            asked.stills,
            lambda tool_m, yaw_rad: kinematics.inverse(tool_down(list(tool_m), yaw_rad)),
            astray_share=asked.astray_share,
        )

    return one


def _trays(asked: Data, _: Film | None) -> One:
    if (asked.lying_share, asked.stacked_share) != (None, None) and not asked.mixed:
        given = "--stacked-share" if asked.lying_share is None else "--lying-share"
        raise InputError(f"{given} is for trays of --mixed; in others every part stands as the configuration says")
    lying = LYING_SHARE if asked.lying_share is None else asked.lying_share
    stacked = STACKED_SHARE if asked.stacked_share is None else asked.stacked_share
    configuration, product = asked.cell()
    settings = settings_of(configuration.devices.simulation)

    def one(seed: int, folder: DataFolder) -> None:
        clutter = mixed_clutter(settings.clutter, seed, lying, stacked) if asked.mixed else settings.clutter
        simulation = settings.model_copy(update={"clutter": clutter})
        kinds = sometimes_steel(product, asked.steel_share, seed)
        objects.write_objects(kinds, configuration.bench, simulation, seed, folder, asked.views)

    return one


DATA_SETS: Mapping[str, DataSet] = {
    "actions": DataSet(
        "Segments of 45 frames: the hand's track, a crop of the hand, and what it did.",
        (*_WORK, "thin", "frames", "gaps", "tracker"),
        _assemblies(actions.write_segments, "thin", "frames", "gaps", "tracker"),
    ),
    "hands": DataSet(
        "Frames of the overhead camera, and where every hand in them is, with what it holds.",
        _WORK,
        _assemblies(hands.write_hands),
    ),
    "holes": DataSet(
        "Crops of the holes, what is in them, and how much of each is hidden.", _WORK, _assemblies(actions.write_holes)
    ),
    "plates": DataSet(
        "Images of the plate with any parts in its holes and hand or arm over it, and what is in each hole.",
        ("person", "stills", "astray_share"),
        _plates,
    ),
    "objects": DataSet(
        "Images of trays from the wrist camera, with type, pose and box of each part.",
        ("views", "mixed", "lying_share", "stacked_share"),
        _trays,
    ),
}


def data_app(film: Film | None = None) -> typer.Typer:
    """A command for each data set.

    Args:
        film: records an assembly in which the controller moves the arm; without, there is no --beside-robot.
    """
    app = typer.Typer(no_args_is_help=True)
    for name, data_set in DATA_SETS.items():
        options = [key for key in (*data_set.common, *data_set.options) if film is not None or key != "beside_robot"]
        make = command_from(Data, *options)(partial(write_data, name=name, film=film))
        app.command(name, help=data_set.help)(make)
    return app


def write_data(asked: Data, *, name: str, film: Film | None) -> None:
    """Write a data set into a new folder."""
    data_set, numbers = DATA_SETS[name], seeds_of(asked.seeds)
    split, _ = seeds(numbers.start, len(numbers))
    make = data_set.maker(asked, film)
    began_s, simulated_s = time.process_time(), 0.0
    with whole_folder(asked.out) as partial_folder:
        folder = DataFolder(partial_folder, _command(name, asked))
        if asked.workers == 1 and asked.scheduler is None:
            lengths = (make(seed, folder) for seed in numbers)
        else:
            pieces = mapped(partial(_piece, make), ((seed,) for seed in numbers), asked.workers, asked.scheduler)
            lengths = (_added(folder, *piece) for piece in pieces)
        for length_s in track(lengths, description=name, console=console(), total=len(numbers)):
            simulated_s += length_s or 0.0
        facts = {"split": split, "first_seed": numbers.start, "recordings": len(numbers)}
        manifest = folder.close({**facts, "simulated_s": round(simulated_s, 1)})
    spent = {"processor_s": round(time.process_time() - began_s, 1)}
    left_out = {"left out: physics diverged": len(folder.left_out)} if folder.left_out else {}
    rows = {"split": split, **manifest["counts"], **left_out, "simulated_s": round(simulated_s, 1), **spent}
    console().print(table(str(asked.out), rows))
    if asked.as_json:
        print_json({**manifest, **spent})


def _command(name: str, asked: Data) -> str:
    """What makes the same data again."""
    lines = [f"--look {asked.look} --seeds {asked.seeds}"]
    lines += [f"--person {asked.person}"] if "person" in DATA_SETS[name].options else []
    for option in ("steel_share", *DATA_SETS[name].options):
        value = getattr(asked, option)
        if option == "person" or not value:
            continue
        shown = "" if value is True else f" {value}" if isinstance(value, str) else f" {value:g}"
        lines.append(f"--{option.replace('_', '-')}{shown}")
    return f"cell lab data {name} {' '.join(lines)}"


def _piece(make: One, seed: int) -> tuple[DataPiece, float | None]:
    """What one recording gives, in a worker."""
    piece = DataPiece()
    return piece, make(seed, piece)


def _added(folder: DataFolder, piece: DataPiece, length_s: float | None) -> float | None:
    folder.add(piece)
    return length_s


app = data_app()  # what trainings call in a process of its own: torch and software OpenGL do not mix
