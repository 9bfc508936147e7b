"""Obstacles of a bench: three shapes, and what is wrong with one is told with its file and line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration
from bracket_ground.errors import InputError
from bracket_ground.interfaces.bench import Obstacle
from tests import ROOT

POST = "{name: post, position_m: [0.62, -0.1, 0.2], box_m: [0.06, 0.06, 0.4]}"
FLAT = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 3 4\n"
IN_MILLIMETRES = "v 0 0 0\nv 100 0 0\nv 0 100 0\nv 0 0 100\nf 1 2 3\nf 1 2 4\nf 2 3 4\nf 1 3 4\n"


def bench_with(folder: Path, *obstacles: str) -> Path:
    """A configuration with obstacles, one a line."""
    for name in ("products.yaml", "sim.yaml"):
        (folder / name).write_text((ROOT / "config" / name).read_text())
    lines = "".join(f"    - {obstacle}\n" for obstacle in obstacles)
    text = (ROOT / "config" / "cell.yaml").read_text().replace("  tray:\n", f"  obstacles:\n{lines}  tray:\n", 1)
    path = folder / "cell.yaml"
    path.write_text(text)
    return path


def test_a_box_a_cylinder_and_a_mesh_reach_as_far_as_they_are_told_to(tmp_path: Path) -> None:
    (tmp_path / "lamp.obj").write_text("v 0 0 0\nv 0.1 0 0\nv 0 0.1 0\nv 0 0 0.3\nf 1 2 3\nf 1 2 4\nf 2 3 4\nf 1 3 4\n")
    lamp = "{name: lamp, position_m: [0.1, 0.5, 0], mesh: lamp.obj}"
    pipe = "{name: pipe, position_m: [0.1, 0.5, 0.2], cylinder_m: [0.08, 0.4]}"
    box, cylinder, mesh = load_configuration(bench_with(tmp_path, POST, pipe, lamp)).bench.obstacles
    reaches = [np.ptp(obstacle.points_m, axis=0) for obstacle in (box, cylinder, mesh)]
    assert np.allclose(reaches[0], (0.06, 0.06, 0.4))
    assert np.allclose(reaches[1], (0.08, 0.08, 0.4))
    assert np.allclose(reaches[2], (0.1, 0.1, 0.3))
    assert np.allclose(mesh.points_m.min(axis=0), (0.1, 0.5, 0.0))


def test_an_obstacle_is_turned_about_its_middle() -> None:
    half = float(np.sqrt(0.5))
    lies = Obstacle(name="bar", position_m=(0.5, 0, 0.3), quaternion_wxyz=(half, 0, half, 0), box_m=(0.4, 0.02, 0.02))
    assert np.allclose(np.ptp(lies.points_m, axis=0), (0.02, 0.02, 0.4), atol=1e-6)


@pytest.mark.parametrize(
    ("obstacle", "words"),
    [
        ("{name: post, position_m: [0.6, 0, 0.2]}", "post has 0 shapes; it needs one of box_m, cylinder_m, mesh"),
        ("{name: post, position_m: [0, 0, 0], box_m: [1, 1, 1], cylinder_m: [1, 1]}", "post has 2 shapes"),
        ("{name: post, position_m: [0.6, 0, 0.2], box_m: [0.1, 0, 0.1]}", "greater than 0"),
        ("{name: post, position_m: [0.6, 0, 0.2], boxes_m: [0.1, 0.1, 0.1]}", "unknown key 'boxes_m'"),
        ("{name: lamp, position_m: [0.6, 0, 0.2], mesh: none.stl}", "there is no file"),
        ("{name: lamp, position_m: [0.6, 0, 0.2], mesh: products.yaml}", "legal: .stl, .obj"),
        ("{name: lamp, position_m: [0.6, 0, 0.2], mesh: flat.obj}", "span no volume"),
        ("{name: lamp, position_m: [0.6, 0, 0.2], mesh: big.obj}", "is it in millimetres?"),
        ("{name: lamp, position_m: [0.6, 0, 0.2], mesh: text.stl}", "cannot be read as a mesh"),
        (POST, "two obstacles of the name 'post'"),
    ],
)
def test_a_wrong_obstacle_is_told_with_file_and_line(tmp_path: Path, obstacle: str, words: str) -> None:
    (tmp_path / "flat.obj").write_text(FLAT)
    (tmp_path / "big.obj").write_text(IN_MILLIMETRES)
    (tmp_path / "text.stl").write_text("no mesh at all")
    path = bench_with(tmp_path, POST, obstacle)
    line = 1 + next(number for number, text in enumerate(path.read_text().splitlines()) if "name: post" in text) + 1
    with pytest.raises(InputError) as told:
        load_configuration(path)
    assert words in str(told.value)
    assert f"{path}:{line}:" in str(told.value)
