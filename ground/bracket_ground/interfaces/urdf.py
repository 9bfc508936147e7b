"""A URDF of an arm: what the program needs of it, and in words what is wrong with it."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from bracket_ground.interfaces.bench import JOINTS

FLANGE = "tool0"
NUMBERS = {"xyz": 3, "rpy": 3, "size": 3, "scale": 3, **dict.fromkeys(("lower", "upper", "radius", "length"), 1)}


def parsed(text: str, path: Path, flange: str) -> ElementTree.Element:
    """A URDF whose flange is moved by as many joints as the program knows.

    Raises:
        ValueError: with what is wrong with it.
    """
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(f"{path}: not a URDF: {error}") from None
    if root.tag != "robot":
        raise ValueError(f"{path}: its root is <{root.tag}>, legal: <robot>")
    if wrong := [*_wrong_tree(root, flange), *_wrong_numbers(root)] or [*_wrong_joints(root, flange)]:
        raise ValueError(f"{path}: {'; '.join(wrong)}")
    return root


def named_alike(root: ElementTree.Element, flange: str) -> str:
    """The URDF with the names of joints and flange that the program has for them, by their places on the chain."""
    for joint, name in zip(turning_joints(root, flange), JOINTS, strict=True):
        joint.set("name", f"{name}_joint")
    names = {flange: FLANGE, FLANGE: flange}
    for item in root.iter():
        for key in ("name", "link"):
            if item.tag in ("link", "parent", "child") and (old := item.get(key, "")) in names:
                item.set(key, names[old])
    return ElementTree.tostring(root, encoding="unicode")


def turning_joints(root: ElementTree.Element, flange: str = FLANGE) -> list[ElementTree.Element]:
    """The joints that move the flange, from the base on."""
    return [joint for joint in chain_to(root, flange) if joint.get("type") != "fixed"]


def chain_to(root: ElementTree.Element, flange: str = FLANGE) -> list[ElementTree.Element]:
    """The joints from the base to the flange."""
    above = {child.get("link"): joint for joint in root.iter("joint") for child in joint.iter("child")}
    chain: list[ElementTree.Element] = []
    link: str | None = flange
    while link in above:
        chain.insert(0, above[link])
        link = next(chain[0].iter("parent")).get("link")
    return chain


def _wrong_tree(root: ElementTree.Element, flange: str) -> Iterator[str]:
    """Whether links and joints are a tree with the flange in it."""
    links = [link.get("name", "") for link in root.findall("link")]
    if flange not in links:
        yield f"no link is the flange {flange!r} (`flange` of the robot's file); links: {', '.join(links) or 'none'}"
    yield from (f"two links are named {link!r}" for link, count in Counter(links).items() if count > 1)
    ends = {side: [_end(joint, side) for joint in root.findall("joint")] for side in ("parent", "child")}
    yield from (f"a joint's {side} {end!r} is no link" for side in ends for end in ends[side] if end not in links)
    yield from (f"two joints carry {link!r}" for link, count in Counter(ends["child"]).items() if count > 1)
    if len(loose := [link for link in links if link not in ends["child"]]) != 1:
        yield f"must have one base, has {', '.join(loose) or 'none, as its joints make a ring'}"


def _wrong_numbers(root: ElementTree.Element) -> Iterator[str]:
    for item in root:
        for part in item.iter():
            for key, count in NUMBERS.items():
                if key in part.attrib and not _are_numbers(part.attrib[key], count):
                    where = f"{item.get('name')}: <{part.tag}> has {key}={part.attrib[key]!r}"
                    yield f"{where}, must be finite numbers: {count}"


def _are_numbers(text: str, count: int) -> bool:
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        return False
    return len(values) == count and all(map(math.isfinite, values))


def _wrong_joints(root: ElementTree.Element, flange: str) -> Iterator[str]:
    """Whether the joints up to the flange are such as the program moves, and no other moves."""
    turning = turning_joints(root, flange)
    if len(turning) != len(JOINTS):
        yield f"{len(turning)} joints move the flange {flange!r}, must be {len(JOINTS)}"
    for joint in turning:
        if joint.get("type") != "revolute":
            yield f"{joint.get('name')} is {joint.get('type')}, must be revolute"
        elif joint.find("limit") is None:
            yield f"{joint.get('name')} has no limit"
    moving = [joint for joint in root.findall("joint") if joint.get("type") != "fixed" and joint not in turning]
    if moving:
        yield f"{', '.join(joint.get('name', '') for joint in moving)} must be fixed, as nothing moves them"


def _end(joint: ElementTree.Element, side: str) -> str:
    return next((end.get("link", "") for end in joint.findall(side)), "")
