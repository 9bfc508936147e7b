"""A URDF of an arm: what the program needs of it, and in words what is wrong with it."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree
from xml.parsers import expat

from bracket_ground.errors import counted

XACRO = ("xacro:", "${", "$(")  # what only its files have, in tags and values
FLANGE = "tool0"
LINE_M = 0.05  # radius of a link that has no shape of its own: slim arms are thinner
LEAST_JOINTS = 6  # fewer cannot bring a tool to any pose
MOST_JOINTS = 30  # a humanoid's spine, arm and finger have half of that; more take minutes to look at
MOST_LINKS = 500  # a humanoid has a third of that
FINGER_JOINTS = 4  # a branch with more of them is an arm
JAW = re.compile("jaw|finger|claw|gripper[^/]*/", re.IGNORECASE)  # in JOINT/CHILD; a wrist often carries `gripper`
TURN_RAD = 2 * math.pi  # a joint without end is used so far each way
MOST_TURNS = 10  # each way
MOVES = ("revolute", "continuous", "prismatic")
MOST_M = 100.0  # a length beyond it is in other units
INERTIAL = {"mass": ("value",), "inertia": ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")}
SHAPES = {
    "box": ("size",), "sphere": ("radius",), "cylinder": ("radius", "length"), "capsule": ("radius", "length"),
    "mesh": ("filename",),
}  # fmt: skip
NUMBERS = {
    **dict.fromkeys(("xyz", "rpy", "size", "scale"), 3),
    **dict.fromkeys(("lower", "upper", "radius", "length", "velocity", "effort", "value", *INERTIAL["inertia"]), 1),
}
EXTENTS = ("size", "radius", "length")
NEVER_NEGATIVE = ("velocity", "effort", "value")
NAMED = ("link", "joint")
READ = {
    *NAMED, "inertial", *INERTIAL, "visual", "collision", "origin", "geometry", *SHAPES,
    "parent", "child", "axis", "limit",
}  # fmt: skip


class Tag(ElementTree.Element):
    """An element that knows its line in the file."""

    line = 0


def parsed(text: str, path: Path, flange: str) -> tuple[ElementTree.Element, list[str]]:
    """A URDF whose flange is moved by enough joints, and the joints beside the arm, which are held at 0.

    Raises:
        ValueError: with what is wrong with it.
    """
    root = element(text, path)
    links = [link.get("name", "") for link in root.findall("link")]
    if flange not in links:
        raise ValueError(
            f"{path}: no link is the flange {flange!r} (`flange` of the robot's file); links: {', '.join(links)}"
        )
    still = held_still(root, flange)
    _reduce(root, flange, still)
    _drop_flat_drawings(root)
    if wrong := [*_wrong_numbers(root), *_wrong_solids(root)] or [*_wrong_joints(root, flange)]:
        raise ValueError(f"{path}: {'; '.join(wrong)}")
    _normalise(root)
    return root, still


def element(text: str, path: Path) -> ElementTree.Element:
    """The root of a URDF, whose links are a tree, its entries with their lines; raises ValueError where it is none."""
    parser = expat.ParserCreate()

    def placed(name: str, values: dict[str, str]) -> Tag:
        tag = Tag(name, {key: value for key, value in values.items() if key != "xmlns" and ":" not in key})
        tag.line = parser.CurrentLineNumber
        return tag

    builder = ElementTree.TreeBuilder(element_factory=placed)
    parser.StartElementHandler, parser.EndElementHandler = builder.start, builder.end
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise ValueError(f"{path}: line {error.lineno}: not well-formed XML: {expat.ErrorString(error.code)}") from None
    root = builder.close()
    if root.tag != "robot":
        raise ValueError(f"{path}: its root is <{root.tag}>, legal: <robot>")
    if (count := len(root.findall("link"))) > MOST_LINKS:
        raise ValueError(f"{path}: has {count} links, at most {MOST_LINKS} are read")
    if any(word in text for entry in root.iter() for text in (entry.tag, *entry.attrib.values()) for word in XACRO):
        raise ValueError(f"{path}: holds macros: let `xacro` make a URDF of it")
    if wrong := [*_wrong_tree(root)]:
        raise ValueError(f"{path}: {'; '.join(wrong)}")
    return root


def finished(root: ElementTree.Element, flange: str) -> str:
    """The URDF with the program's name of the flange."""
    names = {flange: FLANGE, FLANGE: flange}
    for item in root.iter():
        for key in ("name", "link"):
            if item.tag in ("link", "parent", "child") and (old := item.get(key, "")) in names:
                item.set(key, names[old])
    return ElementTree.tostring(root, encoding="unicode")


def mounted(text: str, xyz: str, rpy: str) -> str:
    """The URDF with its base elsewhere in the world."""
    root = ElementTree.fromstring(text)
    children = {_end(joint, "child") for joint in root.findall("joint")}
    base = next(name for link in root.findall("link") if (name := link.get("name", "")) not in children)
    joint = ElementTree.SubElement(root, "joint", name="mounting", type="fixed")
    ElementTree.SubElement(joint, "origin", xyz=xyz, rpy=rpy)
    ElementTree.SubElement(joint, "parent", link="mounting_place")
    ElementTree.SubElement(joint, "child", link=base)
    root.insert(0, ElementTree.Element("link", name="mounting_place"))
    return ElementTree.tostring(root, encoding="unicode")


def solid_links(root: ElementTree.Element, found: Callable[[str], Path | None]) -> tuple[list[str], tuple[str, ...]]:
    """Leave each link its collision shapes, whose meshes get whole paths.

    What is only drawn counts where no link has a collision shape. A link whose mesh is missing is a thick line.

    Args:
        found: where a mesh of this name lies.

    Returns:
        What was taken for granted, in words, and the links whose meshes are missing.
    """
    remarks = []
    if root.find("link/collision") is None and root.find("link/visual") is not None:
        remarks.append("no link has a collision shape: what is drawn of them counts as theirs")
        for drawing in root.findall("link/visual"):
            drawing.tag = "collision"
    missing: dict[str, list[str]] = {}
    for link in root.findall("link"):
        for drawing in link.findall("visual"):
            link.remove(drawing)
        for shape in link.findall("collision"):
            if (mesh := shape.find("geometry/mesh")) is None:
                continue
            if (place := found(mesh.get("filename", ""))) is not None:
                mesh.set("filename", str(place))
                continue
            missing.setdefault(link.get("name", ""), []).append(mesh.get("filename", ""))
            link.remove(shape)
    for name, meshes in missing.items():
        link = next(tag for tag in root.findall("link") if tag.get("name") == name)
        link.extend(_thick_lines(root, name))
        remarks.append(f"{name}: there is no mesh {', '.join(meshes)}; a line {2e3 * LINE_M:g} mm thick stands for it")
    return remarks, tuple(missing)


def _thick_lines(root: ElementTree.Element, link: str) -> Iterator[ElementTree.Element]:
    """Cylinders from a link's origin to the joints that it carries; a ball where there are none."""
    origins = [joint.find("origin") for joint in root.findall("joint") if _end(joint, "parent") == link]
    ends = [[float(word) for word in origin.get("xyz", "0 0 0").split()] for origin in origins if origin is not None]
    long = [end for end in ends if math.hypot(*end) > LINE_M]
    for x, y, z in long:
        shape = ElementTree.Element("collision")
        rpy = f"0 {math.atan2(math.hypot(x, y), z)!r} {math.atan2(y, x)!r}"
        ElementTree.SubElement(shape, "origin", xyz=f"{x / 2!r} {y / 2!r} {z / 2!r}", rpy=rpy)
        solid = ElementTree.SubElement(shape, "geometry")
        ElementTree.SubElement(solid, "cylinder", radius=str(LINE_M), length=repr(math.hypot(x, y, z)))
        yield shape
    if not long:
        shape = ElementTree.Element("collision")
        ElementTree.SubElement(ElementTree.SubElement(shape, "geometry"), "sphere", radius=str(LINE_M))
        yield shape


def turning_joints(root: ElementTree.Element, flange: str = FLANGE) -> list[ElementTree.Element]:
    """The joints that move the flange, from the base on."""
    return [joint for joint in chain_to(root, flange) if joint.get("type") != "fixed"]


def chain_to(root: ElementTree.Element, flange: str = FLANGE) -> list[ElementTree.Element]:
    """The joints from the base to the flange."""
    above = {_end(joint, "child"): joint for joint in root.findall("joint")}
    chain: list[ElementTree.Element] = []
    link: str | None = flange
    while link in above:
        chain.insert(0, above[link])
        link = _end(chain[0], "parent")
    return chain


def likely_flange(root: ElementTree.Element) -> str:
    """The link that a gripper would be mounted on: at the end of the longest arm, before fingers part."""
    carried: dict[str, list[ElementTree.Element]] = {}
    for joint in root.findall("joint"):
        carried.setdefault(_end(joint, "parent"), []).append(joint)
    children = {_end(joint, "child") for joint in root.findall("joint")}
    link = next(name for tag in root.findall("link") if (name := tag.get("name", "")) not in children)
    outwards = list(carried.get(link, ()))
    for joint in outwards:
        outwards += carried.get(_end(joint, "child"), ())
    deep: dict[str, int] = {}  # how many joints move at most from the one before a link to its fingers' ends
    for joint in reversed(outwards):
        child = _end(joint, "child")
        below = (deep[_end(other, "child")] for other in carried.get(child, ()))
        deep[child] = max(below, default=0) + (joint.get("type") != "fixed")
    moved = 0
    while ways := [joint for joint in carried.get(link, ()) if deep[_end(joint, "child")] > 1 or not _closes(joint)]:
        moving = [deep[_end(joint, "child")] for joint in ways]
        if moved >= LEAST_JOINTS and sum(count > 0 for count in moving) > 1 and max(moving) <= FINGER_JOINTS:
            break
        onwards = max(ways, key=lambda joint: (deep[_end(joint, "child")], _rank(_end(joint, "child"))))
        if _rank(link) > _rank(_end(onwards, "child")) and moved >= LEAST_JOINTS:
            break
        moved, link = moved + (onwards.get("type") != "fixed"), _end(onwards, "child")
    return link


def _closes(joint: ElementTree.Element) -> bool:
    """Whether a joint moves a jaw, by its name or what it carries."""
    return joint.get("type") != "fixed" and bool(JAW.search(f"{joint.get('name')}/{_end(joint, 'child')}"))


def _rank(link: str) -> int:
    """How likely a link is the flange by its name: REP 199 has `tool0` on `flange`, whose x points outwards."""
    return link.endswith("flange") + 2 * link.endswith(FLANGE)


def held_still(root: ElementTree.Element, flange: str = FLANGE) -> list[str]:
    """Names of joints beside the arm that could move, and are held at 0."""
    chain = chain_to(root, flange)
    beyond = _beyond(root, flange)
    return [
        joint.get("name", "")
        for joint in root.findall("joint")
        if joint.get("type") != "fixed" and joint not in chain and _end(joint, "child") not in beyond
    ]


def _reduce(root: ElementTree.Element, flange: str, still: list[str]) -> None:
    """What hangs on the flange gives way to the cell's gripper; joints beside the arm are held at 0."""
    beyond = _beyond(root, flange)
    for joint in root.findall("joint"):
        if _end(joint, "child") in beyond:
            root.remove(joint)
        elif joint.get("name", "") in still:
            joint.set("type", "fixed")
    for link in root.findall("link"):
        if link.get("name") in beyond:
            root.remove(link)


def _drop_flat_drawings(root: ElementTree.Element) -> None:
    """Without what is only drawn and has an extent of 0: it shows nothing, and the links have collision shapes."""
    for link in root.findall("link") if root.find("link/collision") is not None else ():
        for drawing in link.findall("visual"):
            texts = [part.get(key, "1") for part in drawing.iterfind("geometry/*") for key in EXTENTS]
            if any(_are_numbers(text, len(text.split())) and 0.0 in map(float, text.split()) for text in texts):
                link.remove(drawing)


def _normalise(root: ElementTree.Element) -> None:
    """What the libraries read differently, or print about, becomes the same to all."""
    root.attrib = {"name": "arm"}
    for item in root.iter():
        item[:] = [part for part in item if part.tag in READ]
    for joint in root.findall("joint"):
        if (axis := joint.find("axis")) is not None:
            values = [float(word) for word in axis.get("xyz", "1 0 0").split()]
            axis.set("xyz", " ".join(repr(value / (math.hypot(*values) or 1.0)) for value in values))
        if joint.get("type") == "fixed":
            continue
        limit = joint.find("limit")
        limit = ElementTree.SubElement(joint, "limit") if limit is None else limit
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            limit.attrib.update(lower=str(-TURN_RAD), upper=str(TURN_RAD))
        for key in ("lower", "upper", "velocity", "effort"):
            limit.attrib.setdefault(key, "0")
    for link in root.findall("link"):
        for shape in [*link.findall("collision"), *link.findall("visual")]:
            if (capsule := shape.find("geometry/capsule")) is not None:
                link.extend(_capsule_ends(shape, capsule))
                capsule.tag = "cylinder"


def _capsule_ends(shape: ElementTree.Element, capsule: ElementTree.Element) -> Iterator[ElementTree.Element]:
    """The balls at both ends of a capsule, which Pinocchio's reader of URDFs does not know."""
    origin = {} if (found := shape.find("origin")) is None else found.attrib
    x, y, z = map(float, origin.get("xyz", "0 0 0").split())
    roll, pitch, yaw = map(float, origin.get("rpy", "0 0 0").split())
    tilt = math.cos(roll) * math.sin(pitch)
    dx = tilt * math.cos(yaw) + math.sin(roll) * math.sin(yaw)
    dy = tilt * math.sin(yaw) - math.sin(roll) * math.cos(yaw)
    dz = math.cos(roll) * math.cos(pitch)
    for half in (-float(capsule.get("length", "")) / 2, float(capsule.get("length", "")) / 2):
        ball = ElementTree.Element(shape.tag)
        ElementTree.SubElement(ball, "origin", xyz=f"{x + half * dx!r} {y + half * dy!r} {z + half * dz!r}")
        ElementTree.SubElement(ElementTree.SubElement(ball, "geometry"), "sphere", radius=capsule.get("radius", ""))
        yield ball


def _beyond(root: ElementTree.Element, flange: str) -> set[str]:
    """Links that hang on the flange."""
    found, before = {flange}, 0
    while len(found) > before:
        before = len(found)
        found |= {_end(joint, "child") for joint in root.findall("joint") if _end(joint, "parent") in found}
    return found - {flange}


def _wrong_tree(root: ElementTree.Element) -> Iterator[str]:
    """Whether links and joints are a tree."""
    links = [link.get("name", "") for link in root.findall("link")]
    if not links:
        yield "has no <link>: a URDF has some, an SRDF has none"
        return
    yield from (f"{_at(item)}a <{item.tag}> has no name" for item in root
                if item.tag in NAMED and not item.get("name"))  # fmt: skip
    yield from (f"two links are named {link!r}" for link, count in Counter(links).items() if count > 1)
    joints = Counter(joint.get("name", "") for joint in root.findall("joint"))
    yield from (f"two joints are named {joint!r}" for joint, count in joints.items() if count > 1)
    ends = {side: [_end(joint, side) for joint in root.findall("joint")] for side in ("parent", "child")}
    yield from (f"a joint's {side} {end!r} is no link" for side in ends for end in ends[side] if end not in links)
    yield from (f"two joints carry {link!r}" for link, count in Counter(ends["child"]).items() if count > 1)
    if len(loose := [link for link in links if link not in ends["child"]]) != 1:
        yield f"must have one base, has {', '.join(loose) or 'none, as its joints make a ring'}"
    elif ring := sorted(set(links) - {*loose} - _beyond(root, loose[0])):
        yield f"joints of {', '.join(ring)} make a ring"


def _wrong_numbers(root: ElementTree.Element) -> Iterator[str]:
    for item in (item for item in root if item.tag in NAMED):
        for part in (part for part in item.iter() if part.tag in READ):
            for key in sorted(part.attrib.keys() & NUMBERS):
                where = f"{_at(part)}{item.get('name')}: <{part.tag}> has {key}={part.attrib[key]!r}"
                if not _are_numbers(part.attrib[key], NUMBERS[key]):
                    yield f"{where}, must be finite numbers: {NUMBERS[key]}"
                    continue
                values = [float(word) for word in part.attrib[key].split()]
                if key in EXTENTS and min(values) <= 0:
                    yield f"{where}, must be above 0"
                elif key == "scale" and 0 in values:
                    yield f"{where}, none may be 0"
                elif key in NEVER_NEGATIVE and min(values) < 0:
                    yield f"{where}, must be 0 or more"
                elif key in ("xyz", *EXTENTS) and part.tag != "axis" and max(map(abs, values)) > MOST_M:
                    yield f"{where}, must be at most {MOST_M:g}: a URDF is in metres"


def _wrong_solids(root: ElementTree.Element) -> Iterator[str]:
    """Whether shapes and masses are whole."""
    solid = "visual" if root.find("link/collision") is None else "collision"
    for link in root.findall("link"):
        for shape in link.findall(solid):
            if len(found := shape.findall("geometry/*")) != 1 or found[0].tag not in SHAPES:
                tags = ", ".join(f"<{part.tag}>" for part in found) or "nothing"
                yield f"{_at(shape)}{link.get('name')}: <{solid}> has {tags}, must have one of {', '.join(SHAPES)}"
            else:
                yield from _lacking(link, found[0], SHAPES[found[0].tag])
        for inertial in link.findall("inertial"):
            for tag, keys in INERTIAL.items():
                yield from _lacking(link, part if (part := inertial.find(tag)) is not None else inertial, keys)


def _lacking(link: ElementTree.Element, part: ElementTree.Element, keys: Sequence[str]) -> Iterator[str]:
    if missing := [key for key in keys if key not in part.attrib]:
        yield f"{_at(part)}{link.get('name')}: <{part.tag}> lacks {', '.join(missing)}"


def _at(item: ElementTree.Element) -> str:
    return f"line {item.line}: " if isinstance(item, Tag) and item.line else ""


def _are_numbers(text: str, count: int) -> bool:
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        return False
    return len(values) == count and all(map(math.isfinite, values)) and text.isascii() and "_" not in text


def _wrong_joints(root: ElementTree.Element, flange: str) -> Iterator[str]:
    """Whether the joints up to the flange are such as the program moves."""
    turning = turning_joints(root, flange)
    if not LEAST_JOINTS <= len(turning) <= MOST_JOINTS:
        count = counted(len(turning), "joint")
        yield f"{count} up to the flange {flange!r}, must be {LEAST_JOINTS} or more, at most {MOST_JOINTS}"
    for joint in turning:
        name, axis = f"{_at(joint)}{joint.get('name')}", joint.find("axis")
        if joint.get("type") not in MOVES:
            yield f"{name} is {joint.get('type') or 'of no type'}, must be {', '.join(MOVES)}"
        elif (limit := joint.find("limit")) is None and joint.get("type") != "continuous":
            yield f"{name} has no <limit>, must have its lower, upper, velocity and effort"
        elif joint.get("type") == "revolute" and limit is not None and _turns(limit) > MOST_TURNS:
            yield f"{name} turns more than {MOST_TURNS} times: limits are in radians; a joint without end is continuous"
        elif joint.find("mimic") is not None:
            yield f"{name} mimics another joint, must move by itself"
        elif axis is not None and not any(map(float, axis.get("xyz", "1 0 0").split())):
            yield f"{name} has no axis: its three numbers are 0"


def _turns(limit: ElementTree.Element) -> float:
    return max(abs(float(limit.get(side, 0))) for side in ("lower", "upper")) / TURN_RAD


def _end(joint: ElementTree.Element, side: str) -> str:
    return next((end.get("link", "") for end in joint.findall(side)), "")
