"""Made-up descriptions of arms: rows of joints, drawn as thick lines of cylinders; and a cell around each."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import copytree

from bracket_ground.interfaces.robot import FOLDER

CONFIG = FOLDER.parent
Row = tuple[str, tuple[float, float, float], str, float, float]  # kind, where on the one before, axis, least, most
TURN = math.pi


@dataclass(frozen=True)
class Drawn:
    """An arm: joints, and the flange on the last, its z along the arm's axis there.

    Attributes:
        flange: where it is on the last joint, and how it is turned (rpy).
    """

    rows: Sequence[Row]
    flange: tuple[tuple[float, float, float], tuple[float, float, float]]
    radius_m: float = 0.045

    def urdf(self) -> str:
        """The description, with links and joints of its own names."""
        parts = ['<robot name="drawn"><link name="foot"/>']
        before = "foot"
        ends = [*(row[1] for row in self.rows[1:]), self.flange[0]]
        for number, ((kind, at, axis, least, most), end) in enumerate(zip(self.rows, ends, strict=True)):
            parts.append(
                f'<link name="l{number}">{self._solid(end)}</link><joint name="ax{number}" type="{kind}">'
                f'<parent link="{before}"/><child link="l{number}"/><origin xyz="{_words(at)}"/><axis xyz="{axis}"/>'
                f'<limit lower="{least}" upper="{most}" velocity="2.2" effort="120"/></joint>'
            )
            before = f"l{number}"
        at, turn = self.flange
        parts.append(
            f'<link name="plate"/><joint name="end" type="fixed"><parent link="{before}"/><child link="plate"/>'
            f'<origin xyz="{_words(at)}" rpy="{_words(turn)}"/></joint></robot>'
        )
        return "".join(parts)

    def _solid(self, end: Sequence[float]) -> str:
        x, y, z = end
        length = math.hypot(x, y, z)
        if length < 2 * self.radius_m:
            return ""
        turn = f"0 {math.atan2(math.hypot(x, y), z)} {math.atan2(y, x)}"
        shape = f'<geometry><cylinder radius="{self.radius_m}" length="{length - self.radius_m}"/></geometry>'
        return f'<collision><origin xyz="{x / 2} {y / 2} {z / 2}" rpy="{turn}"/>{shape}</collision>'


def _words(values: Sequence[float]) -> str:
    return " ".join(map(str, values))


# An arm of six joints with an elbow that goes much farther one way: lengths and ranges of ABB's CRB 15000 data sheet.
ONE_SIDED = Drawn(
    [
        ("revolute", (0, 0, 0.265), "0 0 1", -TURN, TURN),
        ("revolute", (0, 0, 0), "0 1 0", -TURN, TURN),
        ("revolute", (0, 0, 0.444), "0 1 0", math.radians(-225), math.radians(85)),
        ("revolute", (0, 0, 0.110), "1 0 0", -TURN, TURN),
        ("revolute", (0.470, 0, 0), "0 1 0", -TURN, TURN),
        ("revolute", (0, 0, 0.080), "1 0 0", math.radians(-270), math.radians(270)),
    ],
    ((0.101, 0, 0), (0, TURN / 2, 0)),
)
# Seven joints, as KUKA's iiwa 14 has them.
SEVEN = Drawn(
    [
        ("revolute", (0, 0, 0.1575), "0 0 1", -2.96, 2.96),
        ("revolute", (0, 0, 0.2025), "0 1 0", -2.09, 2.09),
        ("revolute", (0, 0, 0.2045), "0 0 1", -2.96, 2.96),
        ("revolute", (0, 0, 0.2155), "0 -1 0", -2.09, 2.09),
        ("revolute", (0, 0, 0.1845), "0 0 1", -2.96, 2.96),
        ("revolute", (0, 0, 0.2155), "0 1 0", -2.09, 2.09),
        ("revolute", (0, 0, 0.081), "0 0 1", -3.05, 3.05),
    ],
    ((0, 0, 0.045), (0, 0, 0)),
)
ON_AXIS = Drawn([("prismatic", (0, 0, 0), "0 1 0", -0.6, 0.6), *ONE_SIDED.rows], ONE_SIDED.flange)
DRAWN = {"one_sided": ONE_SIDED, "seven": SEVEN, "on_axis": ON_AXIS}

NEARER = {  # the bench of an arm that reaches 0.8 m or so
    "position_m: [0.72, 0.14, 0.036]": "position_m: [0.52, 0.14, 0.036]",
    "centre_m: [0.56, -0.38, 0.004]": "centre_m: [0.42, -0.36, 0.004]",
    "size_m: [0.32, 0.40]": "size_m: [0.28, 0.32]",
    "[1.02, 0.34, 0.004]": "[0.82, 0.34, 0.004]",
    "[1.02, 0.14, 0.004]": "[0.82, 0.14, 0.004]",
    "[1.02, -0.08, 0.004]": "[0.82, -0.08, 0.004]",
    "hand_rest_m: [1.12, 0.44, 0.10]": "hand_rest_m: [0.92, 0.44, 0.10]",
    "position_m: [0.82, -0.02, 1.45]": "position_m: [0.62, -0.02, 1.45]",
}


def robot_file(folder: Path, name: str, more: str = "") -> Path:
    """A robot's file with its URDF, in a folder."""
    (folder / f"{name}.urdf").write_text(DRAWN[name].urdf())
    file = folder / f"{name}.yaml"
    file.write_text(f"name: {name}\nurdf: {name}.urdf\nflange: plate\n{more}")
    return file


def cell_file(folder: Path, robot: str, changes: dict[str, str] = NEARER) -> Path:
    """A configuration for a robot beside it, whose resting poses the program finds."""
    if not (folder / "products.yaml").exists():
        copytree(CONFIG, folder, dirs_exist_ok=True)
    text = (folder / "cell.yaml").read_text().replace("robot: ur10 #", f"robot: {robot} #")
    text = re.sub(r"  arm_(park|look)_rad:.*\n", "", text)
    for old, new in changes.items():
        assert old in text, old
        text = text.replace(old, new)
    (folder / "other.yaml").write_text(text)
    return folder / "other.yaml"
