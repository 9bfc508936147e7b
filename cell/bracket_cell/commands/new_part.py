"""`cell new part`: a type of part from a mesh, with how it stands and how it is held, for a person to confirm."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from bracket_ground.errors import InputError
from bracket_ground.files.files import write_whole
from bracket_ground.files.yaml_file import load_yaml, write_values
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product
from btxml.views.picture import to_png

DENSITY_KG_M3 = 2700.0  # of aluminium, where nobody says what the part weighs
MILLIMETRES = 0.001
APART = 1e-4  # by which pieces that touch are shrunk: a shell is what hangs together by common points
LARGEST_M = 1.0  # of a part; what is larger is in millimetres


def part(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Mesh of the part: STL or OBJ.")],
    product: Annotated[Path, typer.Option(help="Product file that gets the type.")] = Path("config/products.yaml"),
    stance: Annotated[int, typer.Option(min=1, help="Number of the stance in the picture.")] = 1,
    scale: Annotated[
        float | None, typer.Option(min=1e-6, max=1000, help="Metres to a unit; by default 0.001 for large numbers.")
    ] = None,
    mass_kg: Annotated[
        float | None, typer.Option("--mass-kg", min=0.001, max=10, help="Mass; by default as of aluminium.")
    ] = None,
) -> None:
    """Add a type of part, named as its mesh file, to a product, and draw how it stands and is held.

    Writes NAME.part.stl and NAME.part.png beside the product file, and the type into it. Look at the picture: another
    --stance makes the type anew.
    """
    from bracket_cell.skills.motion.mesh_part import convex_pieces, stances
    from bracket_cell.skills.motion.settings import MotionSettings
    from bracket_cell.viewing.part_picture import described, part_picture
    from bracket_ground.interfaces.meshes import Mesh, loaded

    name = file.stem
    stl_file, png_file = (product.parent / f"{name}.part.{kind}" for kind in ("stl", "png"))
    if name in load_yaml(product, Product).parts and not stl_file.exists():
        raise InputError(f"{product} has a type {name} already, and not from a mesh; name the file otherwise")
    try:
        read = loaded(file)
    except ValueError as error:
        raise InputError(str(error)) from None
    scale = scale or (MILLIMETRES if float(np.ptp(read.points_m, axis=0).max()) > LARGEST_M else 1.0)
    mesh = Mesh(read.points_m * scale, read.triangles)
    pieces = convex_pieces(mesh)
    found = stances(mesh, pieces, MotionSettings())
    if not found:
        raise InputError(f"{file}: the part has no face on which it would stand")
    if stance > len(found):
        raise InputError(f"--stance {stance}: there are {len(found)}")
    chosen = found[stance - 1]
    mass = mass_kg or round(DENSITY_KG_M3 * sum(piece.volume_m3 for piece in pieces), 3)
    write_whole(stl_file, stl(chosen.hulls_m))
    write_whole(png_file, to_png(part_picture(name, found)))
    entry: dict[str, Any] = {
        "title": name,
        "quantity": 0,
        "mesh": stl_file.name,
        "size_m": [round(extent, 5) for extent in chosen.size_m],
        "colour_rgb": [0.75, 0.45, 0.05],
        "mass_kg": mass,
    }
    write_values(product, {("parts", name): entry})
    load_yaml(product, Product)
    sys.stdout.writelines(
        f"{'*' if number == stance else ' '} {number}  {line}\n"
        for number, one in enumerate(found, start=1)
        for line in ["; ".join(described(one))]
    )
    sys.stdout.write(
        f"{len(pieces)} convex pieces; {product}: {name} added, {png_file} shows the stances\n"
        "It stands at places of the bench; with a quantity above 0, a goal and a bin it is part of the product.\n"
    )


def stl(hulls_m: tuple[Array, ...]) -> bytes:
    """A binary STL file of hulls, each given by its points (n, 3)."""
    from bracket_ground.interfaces.meshes import hull_of

    hulls = [hull_of(points + APART * (points.mean(axis=0) - points)) for points in hulls_m]
    rows = np.zeros(sum(len(hull.triangles) for hull in hulls), dtype=[("f", "<f4", (4, 3)), ("n", "<u2")])
    rows["f"] = np.concatenate([np.concatenate([h.normals[:, None], h.corners_m], axis=1) for h in hulls])
    return b"convex pieces of a part in metres".ljust(80) + len(rows).to_bytes(4, "little") + rows.tobytes()
