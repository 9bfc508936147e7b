"""`cell setup`: what a person does at a new cell before its first run."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
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
from bracket_cell.commands.terminal import console, print_json, table, wait_for_enter
from bracket_cell.configuration import (
    CALIBRATION,
    Configuration,
    load_configuration,
    load_faults,
    load_product,
    located,
    simulated,
    weaknesses,
)
from bracket_cell.learned.calibration.board import CharucoBoard
from bracket_cell.runs.bench_view import BenchView
from bracket_cell.runs.calibrating import Calibrated, stamped_delays_s
from bracket_cell.runs.calibrating import calibrate as calibration_of
from bracket_cell.runs.commissioning import DRY_SHARE, Teaching, dry_run, goal_of, way_to
from bracket_cell.runs.options import LOOK_HELP, SHARE_HELP
from bracket_cell.runs.slow_motion import move_to, opened
from bracket_cell.runs.stopping import measured
from bracket_cell.skills.drivers.settings import Ros2ArmSettings
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.skills.motion.planner import MotionPlanner
from bracket_cell.wiring.devices import joints_by_hand, opened_alone, own_calibration
from bracket_ground.errors import InputError, counted
from bracket_ground.files.files import read_text, whole_or_none
from bracket_ground.files.model import Location
from bracket_ground.files.yaml_file import has_key, load_yaml, read_data, write_values
from bracket_ground.interfaces.bench import Calibration
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.robot import DEFAULT, FOLDER, RobotModel, shipped_robots

unrested = partial(load_configuration, rested=False)
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
    board: Annotated[
        Path | None,
        typer.Option(help="Find the lenses by a ChArUco board that you show: a file with squares, square_m, marker_m."),
    ] = None,
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
    shown = load_yaml(board, CharucoBoard) if board is not None else None
    wrist = load_yaml(path, Calibration).wrist if overhead_only and path.exists() else None
    configuration = simulated(load_configuration(config), look, PERSON)
    product = load_product(configuration, config)
    say = console().print
    say("keep away: the arm moves over the bracket" if not overhead_only else "overhead camera")
    found, cameras, delays_s = calibration_of(
        configuration, product, seed, overhead_only, lambda text: say(text, highlight=False), slower, shown
    )
    say(table("cameras", {name: camera.trouble or _words(camera) for name, camera in cameras.items()}))
    for role in stamped_delays_s(configuration) if cameras.keys() >= {"wrist"} else ():
        delay = f"{1e3 * delays_s[role]:.0f} ms" if role in delays_s else "not seen: is the arm in view?"
        say(f"delay of camera {role}: {delay}", highlight=False)
    if as_json:
        every = {name: camera.as_json() for name, camera in cameras.items()}
        print_json({"file": str(path), "good": found is not None, **every, "delays_s": delays_s})
    if found is None:
        say("nothing was written")
        return 1
    if delays_s:
        write_values(config, {("devices", role, "delay_s"): delay_s for role, delay_s in delays_s.items()}, unrested)
    _write(found.model_copy(update={"wrist": wrist}) if overhead_only else found, path)
    say(f"{path}: to use it, in {config}: calibration: {told_in(config, path)}", highlight=False)
    return 0


def _words(calibrated: Calibrated) -> str:
    fit = calibrated.fit
    off = f"{1e3 * calibrated.off_m:.1f} mm off by the bench file, fit {fit.rms_px:.2f} px"
    return f"{off}, {fit.edges} points of edges, {fit.holes} holes, {fit.images} images"


def _write(found: Calibration, path: Path) -> None:

    data = found.model_dump(mode="json", exclude_none=True)
    text = "# Where the cameras hang and how they see; made by: cell setup calibrate\n" + yaml.safe_dump(
        data, sort_keys=False
    )
    try:
        with whole_or_none(path) as partial:
            partial.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from None


GRIPPER, ROBOT, STOP, OBSTACLES, ACTIVATION_S = "gripper", "robot", "stop", "obstacles", 20.0
JOB = "job"

setup_app = typer.Typer(no_args_is_help=True, help="Make a real cell ready: teach, calibrate, try.")
setup_app.command()(calibrate)


@setup_app.command()
def teach(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME", help="park, look, bracket, tray, gripper, robot, stop, obstacles, or a part type: its bin."
        ),
    ],
    config: ConfigOption = CONFIGURATION,
) -> int:
    """Lead the arm by hand (free drive) and press Enter. The configuration then says where things are.

    With stop, the arm turns each joint and measures how it stops; status 1 if that is worse than reckoned with. With
    obstacles, of an arm behind ROS 2, what stands there by MoveIt's planning scene is taken.
    """
    configuration, product = _read(config, rested=name in (ROBOT, STOP))
    if name == GRIPPER:
        return _teach_gripper(configuration, product, config)
    if name == ROBOT:
        return _teach_robot(configuration, config)
    if name == STOP:
        return _teach_stop(configuration, product, config)
    if name == OBSTACLES:
        return _teach_obstacles(configuration, config)
    motion = MotionPlanner(product, configuration.bench, configuration.motion)
    teaching = Teaching(name, configuration.bench, product, motion)
    with located(config, configuration), joints_by_hand(configuration, product) as joints_now:
        joints = []
        for prompt in teaching.prompts:
            wait_for_enter(prompt)
            joints.append(np.array(joints_now()))
    values, message = teaching.values(joints)
    write_values(config, values, unrested)
    console().print(f"{config}: {message}", highlight=False)
    return 0


@setup_app.command()
def move(
    name: Annotated[
        str, typer.Argument(metavar="NAME", help="park or look; or job: above tray and bracket, touching nothing.")
    ],
    config: ConfigOption = CONFIGURATION,
    share: Annotated[float, typer.Option(min=0.02, max=1, help=SHARE_HELP)] = DRY_SHARE,
    slower: SlowerOption = 1.0,
) -> int:
    """Move the arm once, to a pose, after Enter. Keep away from it, and a hand at the emergency stop."""
    configuration, product = _read(config)
    if name == JOB:
        wait_for_enter(f"the arm goes over tray and bracket at a share of {DRY_SHARE:g}; nothing is touched")
        with located(config, configuration), opened(configuration, product, slower=slower) as devices:
            missed = dry_run(configuration, product, devices, lambda text: console().print(text, highlight=False))
        return 1 if missed else 0
    goal_of(name, configuration.bench)
    motion = MotionPlanner(product, configuration.bench, configuration.motion)
    with located(config, configuration), opened(configuration, product, slower=slower) as devices:
        wait_for_enter(f"to {name}: {way_to(name, devices, configuration.bench, motion)}; at a share of {share:g}")
        move_to(devices, motion, goal_of(name, configuration.bench), share)
    console().print(f"the arm stands at {name}", highlight=False)
    return 0


@setup_app.command()
def bench(
    config: ConfigOption = CONFIGURATION,
    out: Annotated[Path, typer.Option("--out", "-o", help=OUT_HELP)] = Path("bench.svg"),
    as_json: JsonOption = False,
) -> int:
    """Draw what the cameras see and the arm reaches. Status 1 where something is cut off."""
    configuration, product = _read(config, rested=False)
    view = BenchView(configuration.bench, product, MotionPlanner(product, configuration.bench, configuration.motion))
    try:
        out.write_text(view.svg, encoding="utf-8")
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {error.strerror or error}") from None
    for problem in view.problems:
        console().print(problem, highlight=False)
    console().print(f"{out}: {'; '.join(view.remarks)}", highlight=False)
    if advice := view.rest_advice:
        console().print(advice, highlight=False)
    if as_json:
        print_json({"file": str(out), "problems": view.problems, "advice": advice})
    return 1 if view.problems else 0


def _read(config: Path, rested: bool = True) -> tuple[Configuration, Product]:
    configuration = load_configuration(config, rested)
    return configuration, load_product(configuration, config)


def _teach_gripper(configuration: Configuration, product: Product, config: Path) -> int:
    """Let the fingers open and close, and keep where they end."""
    with located(config, configuration), opened_alone(configuration, product, GRIPPER) as (gripper, clock):
        if not hasattr(gripper, "ends"):
            raise InputError("this gripper's driver measures no ends; nothing has to be taught")
        wait_for_enter("take everything out of the fingers: they open and close")
        gripper.activate()
        until_s = clock.now_s() + ACTIVATION_S
        while not gripper.measured:
            gripper.state()
            if clock.now_s() > until_s:
                raise InputError(
                    f"the fingers did not find their ends within {ACTIVATION_S:g} s: is something in them?"
                )
            clock.sleep_until(clock.now_s() + 0.05)
        first, last = gripper.ends
    ends: dict[Location, object] = {
        ("devices", GRIPPER, "open_count"): first,
        ("devices", GRIPPER, "closed_count"): last,
    }
    write_values(config, ends, unrested)
    console().print(f"{config}: the fingers end at {first} and {last}", highlight=False)
    return 0


def _teach_stop(configuration: Configuration, product: Product, config: Path) -> int:
    """Measure how each joint stops, and keep that where separation reads it."""
    say = partial(console().print, highlight=False)
    motion = MotionPlanner(product, configuration.bench, configuration.motion)
    with located(config, configuration), opened(configuration, product) as devices:
        wait_for_enter("each joint turns by up to 0.5 rad about where the arm stands, as fast as it may: keep away")
        found = measured(devices, motion, say)
    data = found.model_dump(mode="json")
    has_motion = has_key(config, "motion")
    values: dict[Location, object] = {("motion", "stopping"): data} if has_motion else {("motion",): {"stopping": data}}
    write_values(config, values, unrested)
    taught = load_configuration(config)
    worse = weaknesses(taught, load_faults(taught))
    for line in worse:
        say(f"worse than reckoned with: {line}")
    say(f"{config}: motion.stopping; separation reckons with a reaction of {taught.motion.separation.reaction_s:.3f} s")
    return 1 if worse else 0


def _teach_obstacles(configuration: Configuration, config: Path) -> int:
    """Take what stands there from the lab's planning scene; what the bench file has by other names is kept."""
    from bracket_cell.plant.ros_obstacles import planning_scene

    if not isinstance(settings := configuration.devices.arm, Ros2ArmSettings):
        raise InputError(f"{config}: devices.arm: obstacles come by an arm of kind ros2, from its planning scene")
    found, left_out = planning_scene(settings)
    for line in left_out:
        console().print(f"left out: {line}", highlight=False)
    names = {obstacle.name for obstacle in found}
    every = [*(obstacle for obstacle in configuration.bench.obstacles if obstacle.name not in names), *found]
    rows = [obstacle.model_dump(mode="json", exclude_defaults=True) for obstacle in every]
    write_values(config, {("bench", OBSTACLES): rows}, load_configuration)
    console().print(f"{config}: {counted(len(found), 'obstacle')} of the planning scene; `cell doctor` looks at them")
    return 1 if left_out else 0


def _teach_robot(configuration: Configuration, config: Path) -> int:
    """Write the arm's own calibration into its file; a robot that is shipped gets one beside the configuration."""
    with located(config, configuration):
        own = own_calibration(configuration)
    named = str(read_data(config, read_text(config)).get(ROBOT, DEFAULT))
    path = config.parent / named
    if named in shipped_robots():
        path = config.parent / f"{named}_own.yaml"
        if path.exists():
            raise InputError(f"{path} is there already: write robot: {path.name} into {config}, then teach it again")
        path.write_text((FOLDER / f"{named}.yaml").read_text())
        write_values(config, {(ROBOT,): path.name}, unrested)
    write_values(path, {("calibration",): own.model_dump(mode="json")}, partial(load_yaml, model=RobotModel))
    taught, here = load_configuration(config), np.array(configuration.bench.arm_look_rad)
    before, after = (Kinematics(cell.motion).position_m(here) for cell in (configuration, taught))
    off_mm = 1e3 * float(np.linalg.norm(after - before))
    console().print(f"{path}: the tool is {off_mm:.1f} mm elsewhere in the pose look; calibrate the cameras again")
    return 0
