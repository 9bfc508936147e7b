"""A simulated camera sees by both focal lengths and the principal point of its bench file."""

from __future__ import annotations

import numpy as np

from bracket_cell.configuration import load_configuration
from bracket_ground.interfaces.camera_model import CameraModel
from bracket_ground.interfaces.pose import Pose
from bracket_sim.scene.lens import Lens
from bracket_sim.scene.look import Camera

AT_EYE = Pose((0.0, 0.0, 0.0))


def test_a_rendered_point_lies_where_the_camera_model_projects_it() -> None:
    shipped = load_configuration("config/cell.yaml").bench.overhead
    setup = shipped.model_copy(update={"focal_y_px": 521.0, "principal_px": (251.3, 168.2)})
    lens, point = Lens(setup, Camera()), np.array([[0.2, -0.15, 1.0]])
    rendered = np.zeros((setup.height_px, setup.width_px, 3), np.uint8)
    pinhole = CameraModel(setup.width_px, setup.height_px, lens.rendered_focal_px)
    column, row = np.round(pinhole.project(AT_EYE, point)[0]).astype(int)
    rendered[row - 2 : row + 3, column - 2 : column + 3] = 255
    rows, columns = np.nonzero(lens.bend(rendered)[..., 0] > 127)
    assert np.abs((columns.mean(), rows.mean()) - setup.model.project(AT_EYE, point)[0]).max() < 1.0
    assert Lens(shipped, Camera()).plain
