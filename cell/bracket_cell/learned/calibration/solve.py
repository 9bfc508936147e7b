"""Finds a camera's mount and lens from sightings of the plate: Levenberg-Marquardt with a prior (Marquardt, 1963)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import product as product_of

import cv2
import numpy as np
from numpy.typing import NDArray

from bracket_cell.learned.calibration.landmarks import PlateModel, Sighting, sight
from bracket_ground.interfaces.bench import Bench, CameraSetup
from bracket_ground.interfaces.camera_model import CameraModel
from bracket_ground.interfaces.places import Mount
from bracket_ground.interfaces.pose import Array, Pose
from bracket_ground.interfaces.product import Product

REACHES_M = (0.03, 0.012, 0.005)  # of the search on the plate, round after round
PRIOR = np.array([0.015] * 3 + [0.02] * 3 + [0.006, 0.04])  # m, rad, share of the focal length, k1
EDGE_PX, HOLE_PX = 0.5, 0.3  # standard deviations of sightings: of an edge, whose points err together, and of a hole
WRIST_POINT_PX = 0.3  # of each point of an edge that the wrist camera sees, once all are found
MOST_RMS_PX = 1.2  # a worse fit is none
MOST_K1 = 0.5  # as a bench may say
HUBER = 2.5  # in those
ROUNDS = 12
LEAST_EDGES = 12  # points of edges that an image needs
START_RAD = 0.02  # of turns about both axes of the view, from which the holes of an empty plate are looked for
LEAST_HOLES = 0.5  # of an empty plate's holes must be seen


@dataclass(frozen=True, eq=False)
class Shot:
    """One image, and where the thing was that the camera is mounted on: the world itself, or the tool."""

    image: NDArray[np.uint8]
    world_from_base: Pose


@dataclass(frozen=True)
class Fit:
    """What the images say about a camera.

    Attributes:
        setup: the camera as found.
        rms_px: root mean square of what the sightings are off after the fit; infinite where nothing was seen.
        edges, holes: points of edges and holes that were seen, over all images.
        images: in how many images the plate was seen.
        far: from the believed camera, in standard deviations of how cameras hang.
    """

    setup: CameraSetup
    rms_px: float
    edges: int
    holes: int
    images: int
    far: float


def fit_camera(
    shots: Sequence[Shot],
    setup: CameraSetup,
    bench: Bench,
    product: Product,
    start: Array | None = None,
    reaches_m: Sequence[float] = REACHES_M,
    last_point_px: float | None = None,
) -> Fit:
    """The camera under which the plate is where the images show it, as near to the believed one as they allow.

    Args:
        start: where the search begins, as PRIOR counts it; at the believed camera by default.
        reaches_m: how far on the plate its edges are searched for, round after round.
        last_point_px: standard deviation of each point of an edge in a last fit to the same sightings; none by default.
    """
    plate = PlateModel.of(bench, product)
    values = np.zeros(len(PRIOR)) if start is None else start
    seen: list[tuple[Shot, Sighting]] = []
    for reach_m in reaches_m:
        camera, mount = _camera(setup, values)
        found = [(shot, sight(shot.image, camera, shot.world_from_base @ mount, plate, reach_m)) for shot in shots]
        seen = [(shot, each) for shot, each in found if each.edges >= LEAST_EDGES]
        if not seen:
            break
        values = _solved(lambda at: _residuals(setup, at, seen), values)  # noqa: B023
    if seen and last_point_px is not None:
        values = _solved(lambda at: _residuals(setup, at, seen, last_point_px), values)
    camera, mount = _camera(setup, values)
    found_setup = setup.model_copy(
        update={
            "mount": Mount(position_m=mount.position_m, quaternion_wxyz=mount.quaternion_wxyz),
            "focal_px": camera.focal_px,
            "focal_y_px": camera.focal_y_px,
            "distortion_k1": camera.distortion_k1,
        }
    )
    off = [_off_px(camera, shot.world_from_base @ mount, each) for shot, each in seen]
    rms = float(np.sqrt(np.mean(np.concatenate(off) ** 2))) if off else math.inf
    edges, holes = (sum(getattr(each, name) for _, each in seen) for name in ("edges", "holes"))
    return Fit(found_setup, rms, edges, holes, len(seen), float(np.linalg.norm(values / PRIOR)))


def fit_wrist_camera(shots: Sequence[Shot], bench: Bench, product: Product) -> Fit:
    """As `fit_camera`, from views in which the walls of holes show: these pull the focal length aside.

    So edges count for more in the end. From the first round on, that would lose cameras that hang far off. One that is
    lost all the same fits badly; then the search begins at other turns, too.
    """

    def fit(turns: tuple[float, ...]) -> Fit:
        return fit_camera(shots, bench.wrist, bench, product, _turned(turns), last_point_px=WRIST_POINT_PX)

    best, others = fit((0.0, 0.0)), product_of((0.0, START_RAD, -START_RAD), repeat=2)
    for turns in list(others)[1:]:
        if best.rms_px <= MOST_RMS_PX:
            break
        best = max(best, fit(turns), key=lambda tried: (tried.rms_px <= MOST_RMS_PX, tried.holes))
    return best


def fit_over_empty_plate(shots: Sequence[Shot], setup: CameraSetup, bench: Bench, product: Product) -> Fit:
    """As `fit_camera`, where every hole is empty: then a camera that hangs far off is found, too, by the holes.

    One that sees the plate further off than the search reaches takes other lines for the plate's edges, and fits them
    well. So the search begins at other turns of the camera, too, and the fit that sees most holes counts. Where one is
    too dark to be seen, the others are also seen one hole further along: then the fit nearest to the believed camera.
    """
    wanted = len(product.bracket.holes_m) * len(shots)
    best = fit_camera(shots, setup, bench, product)
    for turns in product_of((0.0, START_RAD, -START_RAD), repeat=2):
        if best.holes == wanted:
            break
        best = max(
            best, fit_camera(shots, setup, bench, product, _turned(turns)), key=lambda fit: (fit.holes, -fit.far)
        )
    return best


def _turned(turns: Sequence[float]) -> Array:
    """A start at these turns about the two axes of the view."""
    start = np.zeros(len(PRIOR))
    start[3:5] = turns
    return start


def too_few_holes(fit: Fit, product: Product) -> bool:
    """Whether a fit over an empty plate sees so few holes that it may be a fit of something else."""
    return fit.holes < LEAST_HOLES * len(product.bracket.holes_m) * max(1, fit.images)


def holes_off_m(believed: CameraSetup, found: CameraSetup, bench: Bench, product: Product) -> float:
    """How far the holes seem to be from where they are, at most, to who believes in one camera and sees by another."""
    holes = np.array([[*xy, 0.0] for xy in product.bracket.holes_m.values()])
    points = bench.bracket.pose.transform(holes)
    pixels = found.model.project(found.mount.pose, points)
    seen = believed.model.onto_plane(believed.mount.pose, pixels, bench.bracket.position_m[2])
    return float(np.linalg.norm(seen - points, axis=1).max())


def _camera(setup: CameraSetup, values: Array) -> tuple[CameraModel, Pose]:
    """Lens and mount after a shift, a turn (as a rotation vector), and changes of the lens."""
    turn = np.eye(4)
    turn[:3, :3], turn[:3, 3] = cv2.Rodrigues(values[3:6])[0], values[:3]
    longer = 1 + float(values[6])
    camera = replace(
        setup.model,
        focal_px=setup.focal_px * longer,
        focal_y_px=setup.focal_y_px and setup.focal_y_px * longer,
        distortion_k1=min(max(setup.distortion_k1 + float(values[7]), -MOST_K1), MOST_K1),
    )
    return camera, setup.mount.pose @ Pose.from_matrix(turn)


def _residuals(
    setup: CameraSetup, values: Array, seen: Sequence[tuple[Shot, Sighting]], point_px: float | None = None
) -> Array:
    """In standard deviations: what sightings are off along their directions, then what the values are off the prior."""
    camera, mount = _camera(setup, values)
    off = [_off_px(camera, shot.world_from_base @ mount, each) / _spread_px(each, point_px) for shot, each in seen]
    return np.concatenate([*off, values / PRIOR])


def _off_px(camera: CameraModel, eye: Pose, each: Sighting) -> Array:
    """How far landmarks should be seen from where they are seen, along what is known of it."""
    off: Array = ((camera.project(eye, each.points_m) - each.pixels) * each.directions).sum(axis=1)
    return off


def _spread_px(each: Sighting, point_px: float | None) -> Array:
    """Standard deviations of sightings: all points of an edge tell as much as one does, unless each tells by itself."""
    alike = EDGE_PX * np.sqrt(np.bincount(each.sides)[each.sides])
    edges = alike if point_px is None else np.full(each.edges, point_px)
    return np.concatenate([edges, np.full(2 * each.holes, HOLE_PX)])


def _solved(residuals: Callable[[Array], Array], start: Array) -> Array:
    """Values with the least squares of Huber-weighted residuals."""
    values, damping = start, 1e-3
    now = residuals(values)
    for _ in range(ROUNDS):
        weights = _weights(now, len(values))
        slopes = np.column_stack([_slope(residuals, values, now, index) for index in range(len(values))])
        normal = slopes.T @ (weights[:, np.newaxis] * slopes)
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), -slopes.T @ (weights * now))
        tried = residuals(values + step)
        if float((weights * tried**2).sum()) < float((weights * now**2).sum()):
            values, now, damping = values + step, tried, damping / 5
            if float(np.abs(step / PRIOR).max()) < 1e-4:
                break
        else:
            damping *= 10
    return values


def _weights(residuals: Array, priors: int) -> Array:
    weights: Array = np.minimum(1.0, HUBER / np.maximum(np.abs(residuals), 1e-9))
    weights[-priors:] = 1.0
    return weights


def _slope(residuals: Callable[[Array], Array], values: Array, now: Array, index: int) -> Array:
    step = PRIOR[index] * 1e-3
    moved = values.copy()
    moved[index] += step
    slope: Array = (residuals(moved) - now) / step
    return slope
