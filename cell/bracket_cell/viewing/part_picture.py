"""How a part from a mesh can stand and be held, as a picture for who has to choose."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from xml.sax.saxutils import escape

import numpy as np

from bracket_cell.skills.motion.mesh_part import PAD_HIGH_M, GripProposal, Stance
from bracket_ground.interfaces.grasping import PAD_WIDTH_M
from bracket_ground.interfaces.meshes import Mesh, hull_of
from bracket_ground.interfaces.pose import Array

VIEW_PX, LINES_PX = 300, 100
PAD_THICK_M = 0.006
FROM = np.array([0.55, -0.70, 0.45]) / math.sqrt(0.55**2 + 0.70**2 + 0.45**2)  # where the viewer is
LIGHT = np.array([0.3, -0.5, 0.81])
BODY, PAD = (96, 132, 168), (200, 70, 50)


def part_picture(name: str, stances: Sequence[Stance]) -> str:
    """SVG: one view of each stance, with the pads of the best grip, and what is known of it."""
    width, height = VIEW_PX * max(1, len(stances)), VIEW_PX + LINES_PX
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" viewBox="0 0 {width} {height}">',
        f'<rect width="{width}" height="{height}" fill="#fff"/>',
    ]
    for number, stance in enumerate(stances):
        lines += [f'<g transform="translate({VIEW_PX * number} 0)">', *_view(stance), *_words(name, number, stance)]
        lines.append("</g>")
    return "\n".join([*lines, "</svg>"]) + "\n"


def described(stance: Stance) -> list[str]:
    """What is known of a stance, in lines."""
    length, width, height = (round(1000 * extent) for extent in stance.size_m)
    ground = "on a face" if stance.flat else "on edges"
    lines = [f"{length} x {width} x {height} mm", f"stands {ground}, tips at {stance.tips_deg:.0f} degrees"]
    if not stance.grips:
        return [*lines, "cannot be held: too wide, or not in its middle"]
    best = stance.grips[0]
    how = f"by parallel faces of {best.face_m2 * 1e6:.0f} mm2" if best.face_m2 else "along lines, as round things are"
    return [*lines, f"held {best.grip.value}, {best.held_m * 1000:.0f} mm apart", how]


def _words(name: str, number: int, stance: Stance) -> Iterator[str]:
    for row, text in enumerate([f"{name}, stance {number + 1}", *described(stance)]):
        weight = ' font-weight="bold"' if row == 0 else ""
        yield (
            f'<text x="10" y="{VIEW_PX + 18 * row + 12}" font-family="sans-serif" font-size="11"{weight}>'
            f"{escape(text)}</text>"
        )


def _view(stance: Stance) -> Iterator[str]:
    """Faces from the farthest to the nearest; pads last where they are in front."""
    pieces = [(hull_of(points), BODY) for points in stance.hulls_m]
    pieces += [(pad, PAD) for grip in stance.grips[:1] for pad in _pads(grip)]
    right = np.cross(np.array([0.0, 0.0, 1.0]), FROM)
    right /= np.linalg.norm(right)
    down = -np.cross(FROM, right)
    corners = np.concatenate([piece.points_m for piece, _ in pieces])
    flat = np.column_stack([corners @ right, corners @ down])
    low, span = flat.min(axis=0), float(np.ptp(flat, axis=0).max())
    scale, faces = (VIEW_PX - 40) / span, []
    for piece, rgb in pieces:
        for normal, corner in zip(piece.normals, piece.corners_m, strict=True):
            if normal @ FROM > 0:
                shade = 0.45 + 0.55 * max(0.0, float(normal @ LIGHT))
                points = (np.column_stack([corner @ right, corner @ down]) - low) * scale + 20
                faces.append(
                    (
                        float((corner @ FROM).mean()),
                        points,
                        (round(shade * rgb[0]), round(shade * rgb[1]), round(shade * rgb[2])),
                    )
                )
    for _, points, rgb in sorted(faces, key=lambda face: face[0]):
        text = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        yield f'<polygon points="{text}" fill="rgb{rgb}" stroke="rgb{rgb}" stroke-width="0.6"/>'


def _pads(proposal: GripProposal) -> Iterator[Mesh]:
    """Both fingertips, as boxes beside the part."""
    axis = proposal.grip.axis
    for side in (-1, 1):
        middle, size = np.zeros(3), np.zeros(3)
        middle[axis] = side * (proposal.held_m + PAD_THICK_M) / 2
        size[axis], size[1 - axis], size[2] = PAD_THICK_M, PAD_WIDTH_M, PAD_HIGH_M
        middle[2] = proposal.tips_m + PAD_HIGH_M / 2
        yield hull_of(_corners(middle, size))


def _corners(middle: Array, size: Array) -> Array:
    signs = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    corners: Array = signs * size + middle
    return corners
