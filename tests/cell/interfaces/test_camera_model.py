"""A camera with a lens that bends: both ways cancel, and a straight lens changes nothing."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from bracket_ground.interfaces.camera_model import CameraModel
from bracket_ground.interfaces.pose import Pose

PLAIN = CameraModel(480, 360, 420.0)
ABOVE = Pose((0.5, -0.4, 0.5), (0.1, 0.7, 0.7, 0.1))


@pytest.mark.parametrize("lens", [(0.0, 0.0), (-0.06, 0.0), (0.02, -0.01), (-0.2, 0.05)])
def test_bending_and_straightening_cancel(lens: tuple[float, float]) -> None:
    camera = CameraModel(480, 360, 420.0, *lens)
    rng = np.random.default_rng(0)
    pixels = rng.uniform((0, 0), (479, 359), (200, 2))
    assert np.abs(camera.straightened(camera.bent(pixels)) - pixels).max() < 1e-3
    points = camera.onto_plane(ABOVE, pixels, 0.02)
    assert np.abs(camera.project(ABOVE, points) - pixels).max() < 0.05
    assert points[:, 2] == pytest.approx(0.02)


def test_a_barrel_pulls_corners_inwards_and_leaves_the_middle() -> None:
    barrel = CameraModel(480, 360, 420.0, -0.1)
    corner, middle = np.array([[0.0, 0.0]]), PLAIN.matrix[:2, 2][np.newaxis]
    assert (barrel.bent(corner) > corner).all()
    assert np.allclose(barrel.bent(middle), middle)
    assert barrel.bent(corner) is not corner
    assert PLAIN.bent(corner) is corner


REAL = CameraModel(640, 480, 612.0, 0.12, -0.21, 609.5, (301.2, 251.9), 1.3e-3, -0.8e-3, 0.05)


def test_a_lens_projects_as_opencv_does() -> None:
    points = np.random.default_rng(3).uniform((-0.4, -0.3, 0.8), (0.4, 0.3, 1.2), (200, 3))
    seen = REAL.project(Pose((0.0, 0.0, 0.0)), points)
    wanted = cv2.projectPoints(points, np.zeros(3), np.zeros(3), REAL.matrix, np.array(REAL.distortion))[0][:, 0]
    assert np.abs(seen - wanted).max() < 1e-9


def test_a_real_lens_bends_both_ways_onto_a_plane() -> None:
    pixels = np.random.default_rng(0).uniform((0, 0), (639, 479), (200, 2))
    points = REAL.onto_plane(ABOVE, pixels, 0.02)
    assert np.abs(REAL.project(ABOVE, points) - pixels).max() < 1e-3
