"""`cell check` of an arm: words and a drawing, and for no description a traceback."""

from __future__ import annotations

import re
from pathlib import Path

import coal
import numpy as np
import pinocchio
import pytest

from bracket_cell.commands.doctor import examine
from bracket_cell.commands.main import main
from bracket_cell.configuration import DEFAULT_CONFIGURATION, load_configuration
from bracket_cell.skills.motion.kinematics import Kinematics
from bracket_cell.skills.motion.postures import misplaced_flange
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.errors import InputError
from bracket_ground.interfaces.robot import FOLDER, RobotModel, complete
from bracket_ground.interfaces.urdf import element, likely_flange
from tests.arms import DRAWN, cell_file, robot_file

SEVEN = DRAWN["seven"].urdf()
BOX = '<collision><geometry><box size=".1 .1 {}"/></geometry></collision></link><joint name="ax3"'
SOLID = '<collision><geometry><box size=".1 .1 .1"/></geometry></collision>'
FLAT = BOX.replace("collision", "visual")
SNAKE = "".join(
    f'<link name="s{n}"/><joint name="j{n}" type="continuous"><parent link="{f"s{n - 1}" if n else "l6"}"/>'
    f'<child link="s{n}"/></joint>'
    for n in range(31)
)
RAIL = SEVEN.replace('type="revolute"', 'type="prismatic"', 1)
MASS = '<inertial>{}</inertial></link><joint name="ax3"'
WHOLE = '<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'


def solid(shape: str) -> str:
    """A description one of whose links has this for a collision shape."""
    return SEVEN.replace('</link><joint name="ax3"', f'<collision>{shape}</collision></link><joint name="ax3"', 1)


def heavy(values: str) -> str:
    """A description one of whose links has such a mass and inertia."""
    return SEVEN.replace('</link><joint name="ax3"', MASS.format(values), 1)


BROKEN = {
    "no XML": ("<robot", "line 1: not well-formed XML: "),
    "another root": ("<sdf/>", "its root is <sdf>"),
    "macros": ("<robot xmlns:xacro='http://www.ros.org/wiki/xacro'><xacro:arm/></robot>", "let `xacro` make a URDF"),
    "a macro's value": (SEVEN.replace('velocity="2.2"', 'velocity="${speed}"', 1), "let `xacro` make a URDF"),
    "a macro's file": (SEVEN.replace('name="drawn"', 'name="$(arg name)"'), "let `xacro` make a URDF"),
    "nothing in it": ("<robot name='a'/>", "has no <link>"),
    "a link without name": (SEVEN.replace('<link name="foot"/>', "<link/>").replace('"foot"', '""'), "has no name"),
    "a joint without name": (SEVEN.replace('name="ax3" ', ""), "a <joint> has no name"),
    "a joint of no type": (SEVEN.replace('name="ax3" type="revolute"', 'name="ax3"'), "ax3 is of no type"),
    "a number of Python's": (SEVEN.replace('upper="3.05"', 'upper="3_05"'), "must be finite numbers"),
    "digits of another script": (SEVEN.replace('upper="3.05"', 'upper="\u0663"'), "must be finite numbers"),
    "millimetres": (SEVEN.replace("0 0 0.2155", "0 0 215.5"), "a URDF is in metres"),
    "degrees": (SEVEN.replace('upper="3.05"', 'upper="175"'), "limits are in radians"),
    "degrees a second": (SEVEN.replace('velocity="2.2"', 'velocity="180"'), "at most 50 rad/s"),
    "millimetres a second": (RAIL.replace('velocity="2.2"', 'velocity="12"', 1), "at most 10 m/s"),
    "a negative torque": (SEVEN.replace('effort="120"', 'effort="-120"'), "must be 0 or more"),
    "a shape of no kind": (solid("<geometry><cone/></geometry>"), "<collision> has <cone>, must have one of box"),
    "no shape": (solid("<geometry/>"), "<collision> has nothing, must have one of box"),
    "two shapes at once": (solid("<geometry><box/><sphere/></geometry>"), "has <box>, <sphere>, must have one of"),
    "a ball of no size": (solid("<geometry><sphere/></geometry>"), "<sphere> lacks radius"),
    "a mesh of no file": (solid("<geometry><mesh/></geometry>"), "<mesh> lacks filename"),
    "a mesh drawn flat": (solid('<geometry><mesh filename="a" scale="0 1 1"/></geometry>'), "none may be 0"),
    "no mass": (heavy(WHOLE.replace(' value="1"', "")), "<mass> lacks value"),
    "no inertia": (heavy('<mass value="1"/>'), "<inertial> lacks ixx"),
    "a negative mass": (heavy(WHOLE.replace('value="1"', 'value="-1"')), "must be 0 or more"),
    "a mass in words": (heavy(WHOLE.replace('value="1"', 'value="light"')), "must be finite numbers"),
    "links without end": (f"<robot name='a'>{'<link/>' * 501}</robot>", "has 501 links, at most 500"),
    "words for numbers": (SEVEN.replace('lower="-2.09"', 'lower="left"', 1), "must be finite numbers"),
    "no finite number": (SEVEN.replace('xyz="0 0 0.2155"', 'xyz="0 0 nan"', 1), "must be finite numbers"),
    "a ring": (SEVEN.replace('<link name="foot"/>', "").replace('"foot"', '"l6"'), "ring"),
    "a joint to nowhere": (SEVEN.replace('<child link="l4"/>', '<child link="arm"/>'), "is no link"),
    "a name twice": (SEVEN.replace('name="ax4"', 'name="ax3"'), "two joints are named"),
    "too few joints": (re.sub('(ax[0-4]" type=)"revolute"', r'\1"fixed"', SEVEN), "must be 6 or more"),
    "a snake": (re.sub("<link name=\"plate\".*", f"{SNAKE}</robot>", SEVEN), "38 joints up to the flange 's30'"),
    "no axis": (SEVEN.replace('axis xyz="0 -1 0"', 'axis xyz="0 0 0"'), "no axis"),
    "limits the wrong way": (SEVEN.replace('lower="-3.05"', 'lower="4"'), "no value is within its limits"),
    "no speed": (SEVEN.replace('velocity="2.2"', 'velocity="0"'), "no speed"),
    "a floating joint": (SEVEN.replace('name="ax2" type="revolute"', 'name="ax2" type="floating"'), "is floating"),
    "a box inside out": (SEVEN.replace('</link><joint name="ax3"', BOX.format(-1), 1), "must be above 0"),
    "a shape of no size": (SEVEN.replace('</link><joint name="ax3"', BOX.format(0), 1), "must be above 0"),
    "a mesh that is none": (
        SEVEN.replace('</link><joint name="ax3"', BOX.replace("box size", "mesh filename"), 1).format("a"), "mesh"
    ),
}  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def said(capsys: pytest.CaptureFixture[str]) -> str:
    told = capsys.readouterr()
    return told.out + told.err


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_wrong_with_a_description_is_said(name: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text, words = BROKEN[name]
    (folder / "a.urdf").write_text(text)
    (folder / ".1 .1 a").write_text("solid nonsense")
    assert main(["check", "a.urdf"]) == 2
    told = said(capsys)
    assert words in told
    assert told.count("a.urdf") == 1
    assert "urdfdom" not in told
    assert not (folder / "checked_a.png").exists()


def test_what_names_groups_of_an_arm_is_no_tree(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "a.srdf").write_text("<robot name='a'><group name='arm'/></robot>")
    assert main(["check", "a.srdf"]) == 2
    assert "a.srdf: has no <link>: a URDF has some, an SRDF has none" in said(capsys)
    (folder / "a.yaml").write_text("name: a")
    assert main(["show", "a.yaml"]) == 2
    assert "a.yaml: no tree and no log; `cell show product FILE` shows a product" in said(capsys)
    (folder / "a.xml").write_text("name: a")
    assert main(["check", "a.xml"]) == 2
    assert "a.xml:1: this is no tree file: it does not begin with <" in said(capsys)


def test_what_is_wrong_has_its_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "a.urdf").write_text(SEVEN.replace("><", ">\n<").replace('upper="3.05"', 'upper="left"'))
    assert main(["check", "a.urdf"]) == 2
    line = next(n for n, row in enumerate((folder / "a.urdf").read_text().split("\n"), 1) if "left" in row)
    assert f"line {line}: ax6: <limit> has upper='left'" in said(capsys)


ODD = {
    "no name of the robot": SEVEN.replace(' name="drawn"', ""),
    "no torques": SEVEN.replace(' effort="120"', ""),
    "another namespace": SEVEN.replace("<robot", '<robot xmlns="http://www.ros.org" xmlns:b="urn:b" b:c="1"'),
    "words of others": SEVEN.replace("</robot>", '<material/><b:c/><sensor name="s"/></robot>'),
    "a joint's words of others": SEVEN.replace("</joint>", "<safety_controller/><dynamics/><b:c/></joint>"),
    "a long axis": SEVEN.replace('axis xyz="0 1 0"', 'axis xyz="0 1e200 0"'),
    "a short axis": SEVEN.replace('axis xyz="0 1 0"', 'axis xyz="0 1e-200 0"'),
    "a drawing of no size": SEVEN.replace('</link><joint name="ax3"', f"{SOLID}{FLAT.format(0)}", 1),
    "Windows' lines": SEVEN.replace("><", ">\r\n<"),
}


@pytest.mark.parametrize("name", ODD)
def test_what_is_odd_and_means_the_same_is_read_the_same(
    name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    usual, odd = (load_drawn(tmp_path, text) for text in (SEVEN, ODD[name]))
    assert capfd.readouterr().err == ""
    assert len(odd.joint_names) == 7
    joints = np.full(7, 0.3)
    assert np.allclose(kinematics(odd).position_m(joints), kinematics(usual).position_m(joints), atol=1e-9)


def load_drawn(folder: Path, text: str) -> RobotModel:
    file = folder / f"{abs(hash(text))}.urdf"
    file.write_text(text)
    return complete(RobotModel(name="a", urdf=str(file), flange="plate"))


def kinematics(robot: RobotModel) -> Kinematics:
    return Kinematics(MotionSettings().of(robot))


def test_a_capsule_is_as_solid_as_it_is_drawn(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    origin = '<origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/>'
    text = solid(f'{origin}<geometry><capsule radius="0.05" length="0.2"/></geometry>')
    robot = load_drawn(tmp_path, text)
    model = pinocchio.buildModelFromXML(robot.urdf_text)
    shapes = pinocchio.buildGeomFromUrdfString(model, robot.urdf_text, pinocchio.GeometryType.COLLISION)
    own = [item for item in shapes.geometryObjects if item.name.startswith("l3_")]
    balls = [item.placement.translation for item in own if isinstance(item.geometry, coal.Sphere)]
    place = pinocchio.SE3(pinocchio.rpy.rpyToMatrix(0.4, 0.5, 0.6), np.array([0.1, 0.2, 0.3]))
    assert np.allclose(sorted(map(tuple, balls)), sorted(tuple(place.act(np.array([0, 0, z]))) for z in (-0.1, 0.1)))
    assert capfd.readouterr().err == ""


def test_a_long_chain_and_a_lattice_are_read_soon(tmp_path: Path) -> None:
    joint = '<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/></joint>'
    links = "".join(f'<link name="{n}"/>' for n in range(400))
    chain = "".join(joint.format(f"j{n}", n, n + 1) for n in range(399))
    assert likely_flange(element(f"<robot>{links}{chain}</robot>", tmp_path)) == "399"
    lattice = "".join(joint.format(f"{side}{n}", n, n + 1) for n in range(399) for side in "ab")
    with pytest.raises(ValueError, match="two joints carry"):
        likely_flange(element(f"<robot>{links}{lattice}</robot>", tmp_path))


HELD = (
    '<link name="{0}"/><joint name="{0}" type="fixed"><parent link="{1}"/><child link="{0}"/>'
    '<origin rpy="{2}"/></joint>'
)


@pytest.mark.parametrize(
    ("joint", "child"), [("jointGripper", "gripperMover"), ("joint7", "moving_jaw"), ("Claw", "l7")]
)
def test_the_jaw_of_a_gripper_is_no_flange(joint: str, child: str, tmp_path: Path) -> None:
    jaw = (
        f'<link name="{child}"/><joint name="{joint}" type="revolute"><parent link="gripper"/><child link="{child}"/>'
        '<limit lower="-1.5" upper="0" velocity="1" effort="1"/></joint>'
    )
    text = SEVEN.replace("</robot>", f"{HELD.format('gripper', 'plate', '0 0 0')}{jaw}</robot>")
    assert likely_flange(element(text, tmp_path)) == "gripper"
    wrist = text.replace(f'name="{joint}"', 'name="wrist_roll"').replace(f'"{child}"', '"gripper_link"')
    assert likely_flange(element(wrist, tmp_path)) == "gripper_link"


@pytest.mark.parametrize("first", ["ft_frame", "flange"])
def test_the_flange_is_the_link_whose_name_says_so(first: str, tmp_path: Path) -> None:
    sensor, flange = HELD.format("ft_frame", "plate", "3.1416 0 0"), HELD.format("flange", "plate", "0 -1.5708 0")
    others = sensor + flange if first == "ft_frame" else flange + sensor
    text = SEVEN.replace("</robot>", f"{others}{HELD.format('tool0', 'flange', '0 1.5708 0')}</robot>")
    assert likely_flange(element(text, tmp_path)) == "tool0"
    assert likely_flange(element(text.replace("tool0", "camera"), tmp_path)) == "flange"


@pytest.mark.parametrize(("turn", "where"), [("0 0 0", ""), ("0 1.5708 0", "aside"), ("3.1416 0 0", "into the arm")])
def test_a_flange_that_points_elsewhere_is_said(turn: str, where: str, tmp_path: Path) -> None:
    robot = load_drawn(tmp_path, SEVEN.replace('rpy="0 0 0"/></joint></robot>', f'rpy="{turn}"/></joint></robot>'))
    words = misplaced_flange(robot)
    assert where in (words or [""])[0]
    assert bool(words) == bool(where)


def test_a_flange_that_leaves_no_pose_to_rest_in_is_said(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    turned = SEVEN.replace('rpy="0 0 0"/></joint></robot>', 'rpy="3.1416 0 0"/></joint></robot>')
    (folder / "turned.urdf").write_text(turned)
    (folder / "turned.yaml").write_text("name: turned\nurdf: turned.urdf\nflange: plate\n")
    config = cell_file(folder, "turned.yaml")
    with pytest.raises(InputError, match=r"arm_look_rad: .*z of the flange 'plate' points into the arm"):
        load_configuration(config)
    (told,) = [finding for finding in examine(config) if finding.what == "configuration"]
    assert "points into the arm" in told.remedy
    assert main(["check", "turned.yaml", "--config", str(config)]) == 1
    assert "checked_turned.png" in said(capsys)


MESHES = {
    "empty": b"",
    "cut off": b"\0" * 80 + b"\4\0\0\0" + b"\0" * 60,
    "a point": b"\0" * 80 + b"\4\0\0\0" + b"\0" * 200,
    "flat": b"\0" * 80 + b"\2\0\0\0" + 2 * np.array([0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0], "<f4").tobytes() + b"\0" * 4,
    "no numbers": b"\0" * 80 + b"\4\0\0\0" + b"\xff" * 200,
    "words": b"v 0 0 0",
}


@pytest.mark.parametrize("name", MESHES)
def test_a_mesh_without_volume_is_named(name: str, folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (folder / "a.stl").write_bytes(MESHES[name])
    (folder / "a.urdf").write_text(solid('<geometry><mesh filename="a.stl"/></geometry>'))
    assert main(["check", "a.urdf"]) == 2
    told = capfd.readouterr()
    assert "a.stl: no mesh that can be read and has a volume" in told.out + told.err
    assert "coal" not in told.out + told.err


def test_a_file_of_macros_is_no_tree(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "a.urdf.xacro").write_text(BROKEN["macros"][0])
    assert main(["check", "a.urdf.xacro"]) == 2
    assert BROKEN["macros"][1] in said(capsys)


def test_an_arm_is_drawn_with_words_on_what_it_reaches(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot_file(folder, "seven")
    assert main(["check", "seven.yaml", "--config", str(cell_file(folder, "seven.yaml"))]) == 0
    told = said(capsys)
    for words in ("ax6: -3.05 to 3.05", "at rest the tool is at", "reaches all holes", "home_rad", "checked_seven.png"):
        assert words in told
    assert (folder / "checked_seven.png").read_bytes().startswith(b"\x89PNG")


def test_what_the_program_chose_or_did_not_take_is_said(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot_file(folder, "seven", "jerk_rad_s3: [9, 9, 9, 9, 9, 9, 9]\nhome_rad: [0, 0.4, 0, 3.2, 0, 0.7, 4]\n")
    main(["check", "seven.yaml", "--config", str(cell_file(folder, "seven.yaml"))])
    told = said(capsys)
    assert "not given, and chosen by the program: acceleration_rad_s2\n" in told
    assert "home_rad is beyond the limits of ax3, ax6: another one is found" in told


def test_a_bare_description_is_enough(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "bare.urdf").write_text(SEVEN)
    assert main(["check", "bare.urdf", "--config", str(DEFAULT_CONFIGURATION)]) == 1  # of the UR10's bench
    told = said(capsys)
    assert "the flange is taken to be 'plate'" in told
    assert "does not reach" in told


def test_shapes_that_touch_at_rest_are_named(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    thick = BOX.format(".1").replace('size=".1 .1 .1"', 'size=".5 .5 .5"')
    (folder / "a.urdf").write_text(SEVEN.replace('</link><joint name="ax3"', thick, 1))
    main(["check", "a.urdf", "--config", str(cell_file(folder, "ur10"))])
    assert re.search(r"l1 touches l3|l3 touches l5", said(capsys))


def test_trees_and_robots_are_not_checked_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(FOLDER / "ur10.yaml"), "tree.xml"]) == 2
    assert "tree.xml: no robot" in said(capsys)


def test_a_cell_is_sent_to_the_doctor(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", str(DEFAULT_CONFIGURATION)]) == 2
    told = said(capsys)
    assert "cell.yaml: no robot; `cell doctor --config FILE` checks a cell" in told
    assert "XML" not in told
