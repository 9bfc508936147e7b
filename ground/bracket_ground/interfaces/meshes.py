"""Meshes (STL, OBJ) and the convex hulls that stand for them in collisions, on pictures and between fingers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, ValidationInfo

from bracket_ground.interfaces.pose import Array

if TYPE_CHECKING:
    import coal

MESHES = (".stl", ".obj")
MOST_MESH_M = 2.0
FARTHEST, LEAST_DEPTH = 1e6, 1e-4  # of a corner, and of what has a volume, in units of the file
SAME_M = 1e-6  # corners of triangles that are nearer to each other are one point

Triangles = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles of a surface.

    Attributes:
        points_m: (n, 3), each once.
        triangles: (t, 3), numbers of points, counter-clockwise as seen from outside.
    """

    points_m: Array
    triangles: Triangles

    @cached_property
    def corners_m(self) -> Array:
        """Of each triangle, (t, 3, 3)."""
        return self.points_m[self.triangles]

    @cached_property
    def areas_m2(self) -> Array:
        """Of each triangle."""
        areas: Array = np.linalg.norm(self._crosses, axis=1) / 2
        return areas

    @cached_property
    def normals(self) -> Array:
        """Of each triangle, (t, 3), outwards; zero for one without an area."""
        normals: Array = self._crosses / np.maximum(2 * self.areas_m2, 1e-18)[:, None]
        return normals

    @cached_property
    def volume_m3(self) -> float:
        """Enclosed by a closed surface."""
        return float(self._volumes.sum())

    @cached_property
    def middle_m(self) -> Array:
        """Middle of the mass (3,) that a closed surface encloses, the material being alike everywhere."""
        middles = self.corners_m.sum(axis=1) / 4
        middle: Array = self._volumes @ middles / self.volume_m3
        return middle

    @cached_property
    def pieces(self) -> tuple[Mesh, ...]:
        """Its shells: what hangs together by common points."""
        group = np.arange(len(self.points_m))
        while True:
            least = group[self.triangles].min(axis=1)
            after = group.copy()
            np.minimum.at(after, self.triangles.ravel(), np.repeat(least, 3))
            if np.array_equal(after, group):
                break
            group = after
        shells = (self.triangles[group[self.triangles[:, 0]] == shell] for shell in np.unique(group[self.triangles]))
        return tuple(_tidy(self.points_m, shell) for shell in shells)

    @cached_property
    def _crosses(self) -> Array:
        a, b, c = self.corners_m.swapaxes(0, 1)
        crosses: Array = np.cross(b - a, c - a)
        return crosses

    @cached_property
    def _volumes(self) -> Array:
        a, b, c = self.corners_m.swapaxes(0, 1)
        volumes: Array = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
        return volumes


def read_mesh(path: Path) -> Mesh:
    """A mesh from its file; one that did not change is read once.

    Raises:
        ValueError: there is none that can be read, or it is flat or larger than a bench.
    """
    return _read(path, path.stat().st_mtime_ns if path.is_file() else 0)


@cache
def _read(path: Path, _changed_ns: int) -> Mesh:
    mesh = loaded(path)
    if (size_m := float(np.ptp(mesh.points_m, axis=0).max())) > MOST_MESH_M:
        raise ValueError(f"{path} is {size_m:g} m long, legal is at most {MOST_MESH_M:g}: is it in millimetres?")
    return mesh


def loaded(path: Path) -> Mesh:
    """A mesh from its file, whatever its unit.

    Raises:
        ValueError: there is none that can be read, or it is flat.
    """
    if path.suffix.lower() not in MESHES:
        legal = f"legal: {', '.join(MESHES)}; `cell new part` makes them of STEP"
        raise ValueError(f"{path.name} is no mesh that can be read; {legal}")
    if not path.is_file():
        raise ValueError(f"there is no file {path}")
    import coal  # a process that only gets benches and products, ready made, never needs it

    try:
        read = coal.MeshLoader().load(str(path), np.ones(3))
    except (ValueError, RuntimeError) as error:
        raise ValueError(f"{path} cannot be read as a mesh: damaged, empty, or of another kind") from error
    points = np.array(read.vertices(), dtype=np.float64)
    triangles = np.array([[*map(int, (t[0], t[1], t[2]))] for t in map(read.tri_indices, range(read.num_tris))])
    if not (np.abs(points) <= FARTHEST).all():
        raise ValueError(f"{path} has corners that are farther away than {FARTHEST:g}, or nowhere")
    if not spans_volume(points):
        raise ValueError(f"{path} has {len(points)} corners, and they span no volume")
    return _tidy(points, triangles)


def spans_volume(points: Array) -> bool:
    """Whether points (n, 3) are neither too few nor in one plane."""
    return len(points) >= 4 and int(np.linalg.matrix_rank(points - points[0], tol=LEAST_DEPTH)) == 3


def hull_of(points_m: Array) -> Mesh:
    """The convex hull of points (n, 3) that span a volume."""
    import coal

    cloud = coal.StdVec_Vec3s()
    for point in points_m:
        cloud.append(point)
    found: coal.Convex = coal.Convex.convexHull(cloud, True, "Qt")
    faces = [found.polygons(number) for number in range(found.num_polygons)]
    points = np.array([found.point(number) for number in range(found.num_points)])
    triangles = np.array([[face[0], face[1], face[2]] for face in faces])
    mesh = _tidy(points, triangles)
    outwards = np.einsum("ij,ij->i", mesh.normals, mesh.corners_m[:, 0] - mesh.points_m.mean(axis=0)) >= 0
    return Mesh(mesh.points_m, np.where(outwards[:, None], mesh.triangles, mesh.triangles[:, ::-1]))


def _tidy(points_m: Array, triangles: Triangles) -> Mesh:
    """Each point once, and none that no triangle has."""
    _, first, same = np.unique(np.rint(points_m / SAME_M), axis=0, return_index=True, return_inverse=True)
    merged = same.reshape(-1)[triangles]
    used, renamed = np.unique(merged, return_inverse=True)
    return Mesh(points_m[first[used]], renamed.reshape(-1, 3))


def _mesh_file(path: Path, info: ValidationInfo) -> Path:
    path = Path((info.context or {}).get("folder", ".")).resolve() / path
    read_mesh(path)
    return path


MeshFile = Annotated[Path, AfterValidator(_mesh_file)]
"""A mesh that can be read, beside the file that names it."""
