"""`cell new`: a tree file or a leaf in the working folder, each with a test that passes, and a cell of real devices."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from bracket_cell.commands.init import new_cell
from bracket_cell.commands.options import always_loaded, registry_of
from bracket_cell.commands.terminal import console
from bracket_cell.device_settings import KINDS
from bracket_cell.skills.drivers.settings import DRIVEN_BY, EXAMPLES
from bracket_cell.trees.loading import input_problem
from bracket_ground.errors import InputError
from bracket_ground.files.files import write_new, write_whole
from bracket_ground.files.model import Location
from bracket_ground.files.yaml_file import load_yaml, write_values
from bracket_ground.interfaces.meshes import LEAST_DEPTH, MOST_MESH_M, Mesh, hull_of
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product
from btxml.files.parse.version3 import convert
from btxml.files.parse.xml_file import read_xml
from btxml.views.editing import made_at
from btxml.views.picture import to_png

DENSITY_KG_M3 = 2700.0  # of aluminium, where nobody says what the part weighs
APART = 1e-4  # by which pieces that touch are shrunk: a shell is what hangs together by common points
LARGEST_M = 1.0  # of a part; what is larger is in millimetres
REAL_PX = (640, 480)  # a mode of every RealSense D400 and of nearly every USB camera; the drawn cameras have another
REALSENSE_FOCAL_PX = 613.0  # of a D435's colours at that size; cell setup calibrate finds the camera's own


def part(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Shape of the part: STEP, STL or OBJ.")],
    product: Annotated[Path, typer.Option(help="Product file that gets the type.")] = Path("config/products.yaml"),
    stance: Annotated[int, typer.Option(min=1, help="Number of the stance in the picture.")] = 1,
    scale: Annotated[
        float | None, typer.Option(min=1e-6, max=1000, help="Metres to a unit; by default 0.001 for large numbers.")
    ] = None,
    mass_kg: Annotated[
        float | None, typer.Option("--mass-kg", min=0.001, max=10, help="Mass; by default as of aluminium.")
    ] = None,
) -> None:
    """Add a type of part, named as its file (STEP, STL, OBJ), to a product, and draw how it stands and is held.

    Writes NAME.part.stl and NAME.part.png beside the product file, and the type into it. Look at the picture: another
    --stance gives the type another shape, and keeps all else that stands there of it.
    """
    from bracket_cell.skills.motion.mesh_part import stances
    from bracket_cell.skills.motion.settings import MotionSettings
    from bracket_cell.viewing.part_picture import described, part_picture

    name = file.stem
    stl_file, png_file = (product.parent / f"{name}.part.{kind}" for kind in ("stl", "png"))
    known = name in load_yaml(product, Product).parts
    if known and not stl_file.exists():
        raise InputError(f"{product} has a type {name} already, and not from a mesh; name the file otherwise")
    mesh, pieces = _in_metres(file, scale)
    found = stances(mesh, pieces, MotionSettings())
    if not found:
        raise InputError(f"{file}: the part has no face on which it would stand")
    if stance > len(found):
        raise InputError(f"--stance {stance}: there are {len(found)}")
    chosen = found[stance - 1]
    mass = mass_kg or float(f"{DENSITY_KG_M3 * sum(piece.volume_m3 for piece in pieces):.3g}")
    shape: dict[str, Any] = {"mesh": stl_file.name, "size_m": [round(extent, 5) for extent in chosen.size_m]}
    shape |= {"mass_kg": mass_kg} if mass_kg else {}
    entry = {"title": name, "quantity": 0, "colour_rgb": [0.75, 0.45, 0.05], "mass_kg": mass} | shape
    inner: dict[Location, object] = {("parts", name, key): value for key, value in shape.items()}
    _keep(stl_file, stl(chosen.hulls_m), product, inner if known else {("parts", name): entry})
    write_whole(png_file, to_png(part_picture(name, found)))
    sys.stdout.writelines(
        f"{'*' if number == stance else ' '} {number}  {'; '.join(described(pose))}\n"
        for number, pose in enumerate(found, start=1)
    )
    sys.stdout.write(
        f"{len(pieces)} convex pieces; {product}: {name} {'changed' if known else 'added'}, "
        f"{png_file} shows the stances\n"
        "It stands at places of the bench; with a quantity above 0, a goal and a bin it is part of the product.\n"
    )


def _in_metres(file: Path, scale: float | None) -> tuple[Mesh, tuple[Mesh, ...]]:
    """A part's mesh and its convex pieces; raises InputError where it has no size of a part."""
    from bracket_cell.skills.motion.mesh_part import MILLIMETRES, convex_pieces, read_part

    read, unit_m = read_part(file)
    size = float(np.ptp(read.points_m, axis=0).max())
    scale = scale or unit_m or (MILLIMETRES if size > LARGEST_M else 1.0)
    if scale * size > MOST_MESH_M:
        raise InputError(
            f"{file} is {scale * size:.3g} m long with --scale {scale:g}; at most {MOST_MESH_M:g} m is legal"
        )
    mesh = Mesh(read.points_m * scale, read.triangles)
    if not (pieces := convex_pieces(mesh)):
        raise InputError(f"{file}: nothing of it is as thick as {LEAST_DEPTH:g} m with --scale {scale:g}")
    return mesh, pieces


def _keep(stl_file: Path, shape: bytes, product: Path, values: Mapping[Location, object]) -> None:
    """Write a part's shape and what the product says of it, or neither; raises InputError."""
    before = stl_file.read_bytes() if stl_file.exists() else None
    write_whole(stl_file, shape)
    try:
        write_values(product, values, partial(load_yaml, model=Product))
    except InputError:
        stl_file.unlink() if before is None else write_whole(stl_file, before)
        raise


def stl(hulls_m: tuple[Array, ...]) -> bytes:
    """A binary STL file of hulls, each given by its points (n, 3)."""
    hulls = [hull_of(points + APART * (points.mean(axis=0) - points)) for points in hulls_m]
    rows = np.zeros(sum(len(hull.triangles) for hull in hulls), dtype=[("f", "<f4", (4, 3)), ("n", "<u2")])
    rows["f"] = np.concatenate([np.concatenate([h.normals[:, None], h.corners_m], axis=1) for h in hulls])
    return b"convex pieces of a part in metres".ljust(80) + len(rows).to_bytes(4, "little") + rows.tobytes()


def _known(role: str) -> list[str]:
    """Kinds of real devices of a role that the project has drivers for."""
    return [kind for kind in KINDS[role] if kind in EXAMPLES]


def _kinds(role: str) -> str:
    return ", ".join(_known(role))


new_app = typer.Typer(no_args_is_help=True, help="Start a tree file, a node, a part or a real cell of your own.")

NameArgument = Annotated[str, typer.Argument(help="Name in tree files, like CountParts.")]

RESERVED = ("False", "None", "True", "InputPort", "Node", "OutputPort", "Status")  # of Python, and of LEAF
TREE = """<root BTCPP_format="4" main_tree_to_execute="{name}">
  <BehaviorTree ID="{name}">
    <Sequence>
      <ActivateGripper/>
      <MoveTo pose="park"/>
    </Sequence>
  </BehaviorTree>
</root>
"""
TREE_TEST = '''"""Tests of trees/{file}.xml without the cell."""

from bracket_cell.trees import Bench


def test_nothing_moves_while_the_gripper_is_not_active() -> None:
    # S: success, F: failure, R: running, one letter a tick
    bench = Bench("trees/{file}.xml", {{"ActivateGripper": "RF"}})
    assert [bench.tick(), bench.tick()] == ["R", "F"]
    assert bench.started("MoveTo") == 0
'''
LEAF = '''"""The node {name}."""

from btxml import InputPort, Node, OutputPort, Status


class {name}(Node):
    """Say in one line what it does; `cell nodes` prints that."""

    least = InputPort(int, "fails below this number", default=1)
    count = OutputPort(int, "how many there are")

    def update(self) -> Status:
        self.count.set(0)
        self.feedback_message = "nothing is counted yet"
        return Status.FAILURE if self.least.get() > 0 else Status.SUCCESS
'''
LEAF_TEST = '''"""Tests of the node {name} alone."""

from btxml import Status
from bracket_cell.trees.node_library import node_registry
from btxml.testing import alone


def test_too_few_fail() -> None:
    node = alone(node_registry(more=["nodes"]).classes["{name}"]("count"), least=1)
    assert node.execute() is Status.FAILURE
    assert node.feedback_message == "nothing is counted yet"
'''


new_app.command()(part)


@new_app.command()
def tree(
    name: NameArgument,
    old: Annotated[
        Path | None,
        typer.Option("--convert", metavar="FILE", help="File of BehaviorTree.CPP 3 to turn into version 4."),
    ] = None,
) -> int:
    """Write trees/NAME.xml and tests/test_NAME.py; with --convert only the former, and say what cannot be kept."""
    if old is not None:
        return _convert(old, f"trees/{_file(name)}.xml")
    _refuse_taken(name)
    _write(name, "trees/{file}.xml", TREE, TREE_TEST, "cell check {first}; pytest {second}")
    return 0


def _convert(old: Path, new: str) -> int:
    """Write a file of version 3 as one of version 4; status 1 where something is lost."""
    text, root, malformed = read_xml(old)
    found = root.get("BTCPP_format")
    if malformed:
        raise InputError(*map(input_problem, malformed))
    if root.tag != "root" or found not in (None, "3"):
        what = f"BTCPP_format is '{found}'" if root.tag == "root" else f"the outermost element is <{root.tag}>"
        raise InputError(f"{root.place_of('BTCPP_format')}: {what}; only files of version 3 are converted")
    made = convert(old, text)
    write_new(Path(), {new: made.text.encode()})
    sys.stderr.writelines(f"{change.place}: note: {change.what}\n" for change in made.changes)
    sys.stderr.writelines(f"{lost.place}: warning: {lost.what}; {lost.legal}\n" for lost in made.lost)
    console().print(f"{new}\nnext: cell check {new}", highlight=False)
    return 1 if made.lost else 0


@new_app.command()
def leaf(name: NameArgument) -> None:
    """Write nodes/NAME.py and tests/test_NAME.py."""
    _refuse_taken(name)
    then = "pytest {second}; `nodes: [nodes]` in the configuration, or --with nodes, makes it known to every command"
    _write(name, "nodes/{file}.py", LEAF, LEAF_TEST, then)


@new_app.command()
def cell(
    folder: Annotated[Path, typer.Argument(help="Folder to make; existing files are kept.")],
    arm: Annotated[str, typer.Option(help=f"Model of the arm: {', '.join(DRIVEN_BY)}.")],
    gripper: Annotated[str, typer.Option(help=f"Kind of its driver: {_kinds('gripper')}.")],
    cameras: Annotated[str, typer.Option(help=f"Kind of their driver: {_kinds('overhead')}.")] = "v4l2",
) -> None:
    """Make a folder for a cell of real devices, with a commented configuration."""
    chosen = {"arm": _legal("--arm", arm, DRIVEN_BY), "gripper": gripper, "overhead": cameras, "wrist": cameras}
    for role in ("gripper", "overhead"):
        _legal(
            "--gripper" if role == "gripper" else "--cameras", chosen[role], dict.fromkeys(_known(role), chosen[role])
        )
    files = new_cell()
    text = files["config/cell.yaml"].decode()
    text = re.sub(r"(?m)^robot: \S+", f"robot: {arm}", text)
    text = re.sub(r"(?m)width_px: (\d+)\n( *)height_px: \d+\n *focal_px: (\S+)", partial(_camera, cameras), text)
    devices = "".join(_device(role, kind) for role, kind in chosen.items())
    head = "devices: # `cell doctor` tries each without motion, and says what to do (`cell docs real_cell`)\n"
    text = re.sub(r"(?ms)^devices:.*?(?=^\S)", f"{head}{devices}  panel: {{kind: none}}\n\n", text)
    write_new(folder, {**files, "config/cell.yaml": text.encode()})
    tries = (
        *(f"setup {way}" for way in ("teach bracket", "calibrate", "bench", "move park", "move job")),
        "safety sign --by NAME",
    )
    steps = "; ".join(f"cell {words}" for words in ("doctor", *tries))
    console().print(
        f"{folder}: write hosts, ports and devices into config/cell.yaml, then, in this folder: {steps}",
        highlight=False,
        soft_wrap=True,
    )


def _camera(kind: str, drawn: re.Match[str]) -> str:
    """Size and focal length of a real camera, in place of a drawn one's."""
    width, height = REAL_PX
    focal_px = REALSENSE_FOCAL_PX if kind == "realsense" else round(float(drawn[3]) * width / int(drawn[1]), 1)
    return f"width_px: {width}\n{drawn[2]}height_px: {height}\n{drawn[2]}focal_px: {focal_px}"


def _device(role: str, kind: str) -> str:
    lines = "".join(f"    {line}\n" for line in EXAMPLES[kind].splitlines())
    return f"  {role}:\n    kind: {kind}\n{lines}"


def _legal(option: str, value: str, known: Mapping[str, str]) -> str:
    """What an option stands for; raises InputError where it is not legal."""
    if value not in known:
        raise InputError(f"{option} {value}: unknown; legal: {', '.join(known)}")
    return known[value]


def _refuse_taken(name: str) -> None:
    """Raise InputError where a node has the name already, of the cell or of the folder `nodes` beside it."""
    own = dict.fromkeys(str(folder) for folder in (*always_loaded(), "nodes") if Path(folder).is_dir())
    node = registry_of(None, own).classes.get(name)
    if node is not None or name == "SubTree":
        place = None if node is None else made_at(node)
        raise InputError(f"there is a node '{name}' already, at {place or 'the language'}; choose another name")


def _file(name: str) -> str:
    """The file of a node or tree, without its ending; raises InputError where nothing can have such a name."""
    if not re.fullmatch(r"[A-Z][A-Za-z0-9]{0,60}", name) or name in RESERVED:
        raise InputError(
            f"'{name}' cannot name a node or tree; use letters and digits with a capital first, like CountParts, but "
            f"not {', '.join(RESERVED)}"
        )
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


def _write(name: str, path: str, text: str, test: str, then: str) -> None:
    file = _file(name)
    files = {path.format(file=file): text, f"tests/test_{file}.py": test}
    write_new(Path(), {place: content.format(name=name, file=file).encode() for place, content in files.items()})
    first, second = files
    console().print(f"{first}\n{second}\nnext: {then.format(first=first, second=second)}", highlight=False)
