"""From a mesh to a part: convex pieces, faces it can stand on, and parallel faces that the fingers can close on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from bracket_cell.packages import needed
from bracket_cell.skills.motion.grasp_pose import fingertips_m
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.errors import InputError
from bracket_ground.interfaces.grasping import PAD_WIDTH_M
from bracket_ground.interfaces.grip import Grip
from bracket_ground.interfaces.meshes import Mesh, hull_of, loaded, spans_volume
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import PartType
from bracket_ground.interfaces.solid import Solid, span_m

CONCAVITY, MOST_PIECES, SEED = 0.05, 12, 0  # of CoACD: its own default; more pieces cost simulation time
FACET = 0.9998  # cosine of 1.1 degrees: hull triangles that differ less are one face
PARALLEL = 0.996  # cosine of 5 degrees: pads of rubber give way to so much
STEEP_MOST = 0.05  # cosine to the vertical of a face that fingers can close on
LEAST_MARGIN_M = 0.001  # of the middle of mass, inside of the face that a part stands on
STEP = (".step", ".stp")
SAG_MM, MILLIMETRES = 0.05, 0.001  # of a round face beside the triangles that stand for it; OpenCASCADE's unit
PAD_HIGH_M = 0.022  # of usual fingertips
CENTRED_M = 0.003  # by which what the fingers hold may be beside the part's middle
LEAST_FACE_M2 = 5e-5  # below a part that stands on a face
HEADINGS = 4  # of the steepest, largest faces that are tried
MOST_STANCES = 4
ALIKE_M = 1e-4


@dataclass(frozen=True)
class GripProposal:
    """How the fingers would hold a part that stands.

    Attributes:
        held_m: distance between the pads.
        tips_m: height of the fingertips above the body's bottom.
        face_m2: area of the smaller of two parallel faces between the pads; 0 where they touch along lines only.
    """

    grip: Grip
    held_m: float
    tips_m: float
    face_m2: float


@dataclass(frozen=True, eq=False)
class Stance:
    """A way in which a part can stand, as a type of part.

    Attributes:
        size_m, hulls_m: of the body in the part's frame, each hull by its points (n, 3).
        tips_deg: by how much the floor may tilt before it tips over.
        flat: it stands on a face, and not on edges alone.
        grips: how it can be held, the best first; none where the stroke is too short.
    """

    size_m: tuple[float, float, float]
    hulls_m: tuple[Array, ...]
    tips_deg: float
    flat: bool
    grips: tuple[GripProposal, ...]

    @property
    def worth(self) -> tuple[float, ...]:
        """What it is sorted by: it can be held, stands on a face, is held by parallel faces, and stands firmly."""
        best = self.grips[0].face_m2 / (PAD_WIDTH_M * PAD_HIGH_M) if self.grips else -1.0
        return self.grips != (), self.flat, min(best, 1.0) + min(self.tips_deg, 30.0) / 30.0, -self.size_m[2]


def read_part(path: Path) -> tuple[Mesh, float | None]:
    """A mesh from a file of any kind, and metres to its unit where that is sure, as of STEP (by OpenCASCADE).

    Raises:
        InputError: it cannot be read, or it is a STEP file and the package that reads these is not installed.
    """
    try:
        if path.suffix.lower() not in STEP:
            return loaded(path), None
        if not path.is_file():
            raise InputError(f"there is no file {path}")
        cascadio: Any = needed("cascadio", "a STEP file", extra="mesh")
        with TemporaryDirectory() as folder:
            obj = Path(folder, "part.obj")
            if cascadio.step_to_obj(str(path), str(obj), SAG_MM, use_colors=False) or not obj.exists():
                raise InputError(f"{path} cannot be read as a STEP file; does the program that made it open it?")
            return loaded(obj), MILLIMETRES
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None


def convex_pieces(mesh: Mesh) -> tuple[Mesh, ...]:
    """Hulls that together are nearly a mesh: by CoACD (Wei et al. 2022) for each shell that is not convex.

    Stray triangles and sheets, which span no volume, are left out.

    Raises:
        InputError: a shell is not convex, and CoACD is not installed.
    """
    found: list[Mesh] = []
    for shell in (shell for shell in mesh.pieces if spans_volume(shell.points_m)):
        hull = hull_of(shell.points_m)
        if abs(shell.volume_m3) > (1 - CONCAVITY / 5) * hull.volume_m3:
            found.append(hull)
            continue
        coacd: Any = needed("coacd", "a mesh that is not convex", extra="mesh")
        coacd.set_log_level("error")
        given = coacd.Mesh(shell.points_m, shell.triangles)
        made = coacd.run_coacd(given, threshold=CONCAVITY, max_convex_hull=MOST_PIECES, seed=SEED)
        found += [hull_of(np.asarray(points)) for points, _ in made]
    return tuple(found)


def stances(mesh: Mesh, pieces: Sequence[Mesh], settings: MotionSettings) -> tuple[Stance, ...]:
    """How a part can stand and be held, the best first; mirrored ones once."""
    volumes = np.array([piece.volume_m3 for piece in pieces])
    mass_m = volumes @ np.array([piece.middle_m for piece in pieces]) / volumes.sum()
    found: list[Stance] = []
    for down, margin_m, height_m in _faces(hull_of(np.concatenate([piece.points_m for piece in pieces])), mass_m):
        tips_deg = math.degrees(math.atan2(margin_m, height_m))
        found += [_stance(mesh, pieces, turn, tips_deg, settings) for turn in _turns(mesh, down)]
    best: list[Stance] = []
    for candidate in sorted(found, key=lambda stance: stance.worth, reverse=True):
        if not any(np.allclose(candidate.size_m, other.size_m, atol=ALIKE_M) for other in best):
            best.append(candidate)
    return tuple(best[:MOST_STANCES])


def _faces(hull: Mesh, mass_m: Array) -> Iterator[tuple[Array, float, float]]:
    """Faces that carry the mass: outward normal, how far inside of its edges the mass is, and how high above it."""
    left = hull.areas_m2 > 0
    while left.any():
        normal = hull.normals[np.flatnonzero(left)[hull.areas_m2[left].argmax()]]
        first = hull.corners_m[np.flatnonzero(left)[hull.areas_m2[left].argmax()], 0]
        same = left & (hull.normals @ normal > FACET) & (np.abs((hull.corners_m[:, 0] - first) @ normal) < ALIKE_M)
        left = left & ~same
        margin_m = _margin_m(hull, same, normal, mass_m)
        if margin_m > LEAST_MARGIN_M:
            yield normal, margin_m, float((first - mass_m) @ normal)


def _margin_m(hull: Mesh, face: Array, normal: Array, mass_m: Array) -> float:
    """How far the mass, along the normal, is inside of the edges of a face."""
    edges = [(int(a), int(b)) for row in hull.triangles[face] for a, b in zip(row, np.roll(row, -1), strict=True)]
    outer = [(a, b) for a, b in edges if (b, a) not in set(edges)]
    found = []
    for a, b in outer:
        along = hull.points_m[b] - hull.points_m[a]
        inwards = np.cross(normal, along / np.linalg.norm(along))
        found.append(float((mass_m - hull.points_m[a]) @ inwards))
    return min(found, default=-1.0)


def _turns(mesh: Mesh, down: Array) -> Iterator[Array]:
    """Rotations (3, 3) with a face down and another one, of the largest that then stand upright, across.

    Where none stands upright, the largest of those that lean.
    """
    lean = np.abs(mesh.normals @ down)
    left = (lean < (STEEP_MOST if (lean < STEEP_MOST).any() else PARALLEL)) & (mesh.areas_m2 > 0)
    for _ in range(HEADINGS):
        if not left.any():
            break
        across = mesh.normals[np.flatnonzero(left)[mesh.areas_m2[left].argmax()]]
        left = left & (np.abs(mesh.normals @ across) < PARALLEL)
        y = across - (across @ down) * down
        y = y / np.linalg.norm(y)
        yield np.array([np.cross(y, -down), y, -down])


def _stance(mesh: Mesh, pieces: Sequence[Mesh], turned: Array, tips_deg: float, settings: MotionSettings) -> Stance:
    """The part in its own frame: in the middle of its bottom, its length along x."""
    points = np.concatenate([piece.points_m for piece in pieces]) @ turned.T
    extents = np.ptp(points, axis=0)
    if extents[0] < extents[1]:
        quarter = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
        turned, points, extents = quarter @ turned, points @ quarter.T, extents[[1, 0, 2]]
    low, high = points.min(axis=0), points.max(axis=0)
    origin = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    hulls = tuple(piece.points_m @ turned.T - origin for piece in pieces)
    size_m = (float(extents[0]), float(extents[1]), float(extents[2]))
    surface = Mesh(mesh.points_m @ turned.T - origin, mesh.triangles)
    under = (surface.normals[:, 2] < -PARALLEL) & (surface.corners_m[..., 2].max(axis=1) < CENTRED_M / 3)
    flat = bool(surface.areas_m2[under].sum() > LEAST_FACE_M2)
    return Stance(size_m, hulls, tips_deg, flat, tuple(_grips(part_type(size_m, hulls), surface, settings)))


def part_type(size_m: tuple[float, float, float], hulls_m: Sequence[Array], **others: Any) -> PartType:
    """A type of part that stands on its body."""
    given = {"title": "part", "colour_rgb": (0.5, 0.5, 0.5), "mass_kg": 0.1, **others}
    return PartType(size_m=size_m, shape=tuple(Solid.hull(points) for points in hulls_m), **given)


def _grips(kind: PartType, surface: Mesh, settings: MotionSettings) -> list[GripProposal]:
    """Ways to hold it in its middle, by the largest parallel faces first."""
    found = []
    for grip in settings.gripper.grips(kind, settings.least_finger_clearance_m):
        tips_m = fingertips_m(kind, grip, settings)
        windows = {1 - grip.axis: (-PAD_WIDTH_M / 2, PAD_WIDTH_M / 2), 2: (tips_m, math.inf)}
        span = span_m(kind.solids, grip.axis, windows)
        if span is None or abs(span[0] + span[1]) > 2 * CENTRED_M:
            continue
        faces = [_between_pads(surface, grip.axis, side, at, tips_m) for side, at in zip((-1, 1), span, strict=True)]
        found.append(GripProposal(grip, span[1] - span[0], tips_m, min(faces)))
    return sorted(found, key=lambda proposal: -proposal.face_m2)


def _between_pads(surface: Mesh, axis: int, side: int, at_m: float, tips_m: float) -> float:
    """Area that a pad meets of faces at a coordinate of an axis that look to a side, by points spread over them."""
    faces = np.flatnonzero(side * surface.normals[:, axis] > PARALLEL)
    faces = faces[np.abs(surface.corners_m[faces, :, axis].mean(axis=1) - at_m) < CENTRED_M / 3]
    if not len(faces):
        return 0.0
    spread = np.array([(a, b, 1 - a - b) for a in _SHARES for b in _SHARES if a + b <= 1])
    points = np.einsum("sk,fkx->fsx", spread, surface.corners_m[faces])
    inside = (np.abs(points[..., 1 - axis]) < PAD_WIDTH_M / 2) & (points[..., 2] > tips_m)
    inside &= points[..., 2] < tips_m + PAD_HIGH_M
    return float(surface.areas_m2[faces] @ inside.mean(axis=1))


_SHARES = np.linspace(0.0, 1.0, 15)
