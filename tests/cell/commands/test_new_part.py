"""`cell new part`: a mesh becomes a type of part in the product's file, with a picture of how it stands and is held."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from bracket_cell.commands.main import main
from bracket_cell.commands.new import stl
from bracket_cell.skills.motion.mesh_part import convex_pieces, stances
from bracket_cell.skills.motion.settings import MotionSettings
from bracket_ground.errors import InputError
from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.grip import Grip
from bracket_ground.interfaces.meshes import Mesh, hull_of, loaded
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product
from tests import ROOT
from tests.cell.commands.step_file import step_file
from tests.cell.interfaces.test_meshes import box

HOUSING = ROOT / "config" / "examples" / "mesh" / "housing.stl"  # in millimetres, turned and beside the origin


@pytest.fixture
def product(tmp_path: Path) -> Path:
    path = tmp_path / "products.yaml"
    path.write_text((ROOT / "config" / "products.yaml").read_text())
    return path


def turned(seed: int) -> Array:
    """A rotation (3, 3) drawn at random."""
    q, r = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    rotation: Array = q * np.sign(np.linalg.det(q))
    return rotation


def test_a_mesh_is_added_drawn_and_can_be_loaded(product: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = product.read_text()
    assert main(["new", "part", str(HOUSING), "--product", str(product)]) == 0
    told = capsys.readouterr().out
    assert "60 x 30 x 40 mm; stands on a face" in told
    assert "held across the width, 30 mm apart" in told
    kind = load_yaml(product, Product).parts["housing"]
    assert kind.size_m == pytest.approx((0.06, 0.03, 0.04), abs=1e-4)
    assert (kind.quantity, kind.peg_length_m) == (0, 0.0)
    assert kind.mass_kg == pytest.approx(2700 * 46.8e-6, rel=0.02)
    assert product.with_name("housing.part.png").read_bytes().startswith(b"\x89PNG")
    assert all(line in product.read_text() for line in before.splitlines()), "comments and all else stay"


def test_another_stance_makes_the_type_anew(product: Path) -> None:
    for stance in ("1", "2"):
        assert main(["new", "part", str(HOUSING), "--product", str(product), "--stance", stance]) == 0
    assert load_yaml(product, Product).parts["housing"].size_m == pytest.approx((0.06, 0.04, 0.03), abs=1e-4)


def test_another_stance_keeps_what_a_person_wrote_of_the_type(tmp_path: Path) -> None:
    path = tmp_path / "product.yaml"
    path.write_text((ROOT / "config" / "examples" / "mesh" / "product.yaml").read_text())
    (tmp_path / "housing.part.stl").write_bytes(HOUSING.with_name("housing.part.stl").read_bytes())
    before = load_yaml(path, Product).parts["housing"]
    assert main(["new", "part", str(HOUSING), "--product", str(path), "--stance", "2"]) == 0
    after = load_yaml(path, Product).parts["housing"]
    assert after.size_m == pytest.approx((0.06, 0.04, 0.03), abs=1e-4)
    assert after.model_dump(exclude={"size_m", "shape"}) == before.model_dump(exclude={"size_m", "shape"})


@pytest.mark.parametrize(("unit", "millimetres"), [(".MILLI.", 1.0), ("$", 0.001)])
def test_a_step_file_is_a_part_too_in_whichever_unit(unit: str, millimetres: float, product: Path) -> None:
    read = loaded(HOUSING)
    file = product.parent / "housing.STEP"
    file.write_text(step_file(Mesh(read.points_m * millimetres, read.triangles), unit))
    assert main(["new", "part", str(file), "--product", str(product)]) == 0
    kind = load_yaml(product, Product).parts["housing"]
    assert kind.size_m == pytest.approx((0.06, 0.03, 0.04), abs=1e-4)
    assert kind.mass_kg == pytest.approx(2700 * 46.8e-6, rel=0.02)


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (["{folder}/part.step"], "there is no file"),
        (["{folder}/bad.stp"], "cannot be read as a STEP file"),
        (["{folder}/part.iges"], "is no mesh that can be read"),
        (["{folder}/nothing.stl"], "there is no file"),
        ([str(HOUSING), "--stance", "9"], "there are 3"),
    ],
)
def test_what_cannot_be_added_leaves_the_product_as_it_was(
    arguments: list[str], why: str, product: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (product.parent / "bad.stp").write_text("ISO-10303-21;")
    before = product.read_text()
    given = [word.format(folder=product.parent) for word in arguments]
    assert main(["new", "part", *given, "--product", str(product)]) == 2
    assert why in capsys.readouterr().err
    assert product.read_text() == before


@pytest.mark.parametrize("seed", range(5))
def test_a_block_stands_on_each_of_its_faces_however_its_file_is_turned(seed: int) -> None:
    size = (0.03, 0.04, 0.055)
    mesh = hull_of(box(size) @ turned(seed).T + np.random.default_rng(seed).uniform(-0.2, 0.2, 3))
    found = stances(mesh, convex_pieces(mesh), MotionSettings())
    assert {tuple(sorted(round(extent, 4) for extent in stance.size_m)) for stance in found} == {size}
    assert sorted(round(stance.size_m[2], 4) for stance in found) == sorted(size)
    assert all(stance.flat and stance.grips and stance.grips[0].face_m2 > 2e-4 for stance in found)
    assert all(stance.size_m[0] >= stance.size_m[1] for stance in found)


def test_what_is_too_wide_cannot_be_held() -> None:
    mesh = hull_of(box((0.12, 0.12, 0.12)))
    assert all(not stance.grips for stance in stances(mesh, convex_pieces(mesh), MotionSettings()))


def test_a_pyramid_does_not_stand_on_its_tip() -> None:
    points = np.array([(0, 0, 0), (0.04, 0, 0), (0.04, 0.04, 0), (0, 0.04, 0), (0.02, 0.02, 0.03)], dtype=float)
    mesh = hull_of(points)
    found = stances(mesh, convex_pieces(mesh), MotionSettings())
    assert found[0].size_m == pytest.approx((0.04, 0.04, 0.03))


def test_concave_shells_are_parted_and_convex_ones_are_not() -> None:
    read = loaded(HOUSING)
    mesh = Mesh(read.points_m / 1000, read.triangles)
    pieces = convex_pieces(mesh)
    assert len(pieces) > 1
    assert sum(piece.volume_m3 for piece in pieces) == pytest.approx(mesh.volume_m3, rel=0.02)
    whole = hull_of(mesh.points_m)
    assert len(convex_pieces(whole)) == 1
    assert sum(piece.volume_m3 for piece in pieces) < 0.8 * whole.volume_m3


def test_a_grip_is_across_the_faces_that_are_parallel() -> None:
    read = loaded(HOUSING)
    mesh = Mesh(read.points_m / 1000, read.triangles)
    best = stances(mesh, convex_pieces(mesh), MotionSettings())[0].grips[0]
    assert (best.grip, round(best.held_m, 4)) == (Grip.WIDTH, 0.03)


def test_pieces_that_touch_stay_pieces(tmp_path: Path) -> None:
    file = tmp_path / "two.stl"
    file.write_bytes(stl((box((0.02, 0.03, 0.04)), box((0.02, 0.03, 0.04), (0.02, 0.0, 0.0)))))
    assert len(loaded(file).pieces) == 2


def written(path: Path, corners: Array) -> Path:
    """Triangles (n, 3, 3) as a binary STL file."""
    rows = np.zeros(len(corners), dtype=[("f", "<f4", (4, 3)), ("n", "<u2")])
    rows["f"][:, 1:] = corners
    path.write_bytes(b"".ljust(80) + len(rows).to_bytes(4, "little") + rows.tobytes())
    return path


BLOCK, BEAD = (hull_of(box(size)).corners_m for size in ((40.0, 30.0, 20.0), (6.0, 5.0, 5.0)))


def test_a_stray_triangle_is_no_piece(product: Path) -> None:
    stray = np.array([[[90.0, 0, 0], [91.0, 0, 0], [90.0, 1, 0]]])
    file = written(product.parent / "block.stl", np.concatenate([BLOCK, stray]))
    assert main(["new", "part", str(file), "--product", str(product)]) == 0
    assert len(convex_pieces(loaded(file))) == 1
    assert sorted(load_yaml(product, Product).parts["block"].size_m) == pytest.approx([0.02, 0.03, 0.04])


@pytest.mark.parametrize(
    ("factor", "options", "words"),
    [
        (1e30, (), "corners that are farther away than 1e\\+06"),
        (np.nan, (), "corners that are farther away than 1e\\+06, or nowhere"),
        (1.0, ("--scale", "1"), "is 40 m long with --scale 1; at most 2 m is legal"),
        (1.0, ("--scale", "1e-6"), "nothing of it is as thick as 0.0001 m with --scale 1e-06"),
    ],
)
def test_sizes_that_no_part_has_are_refused(
    product: Path, capfd: pytest.CaptureFixture[str], factor: float, options: tuple[str, ...], words: str
) -> None:
    file, before = (
        written(product.parent / "block.stl", factor * BLOCK),
        product.read_text(),
    )
    assert main(["new", "part", str(file), "--product", str(product), *options]) == 2
    assert re.search(words, capfd.readouterr().err)
    assert product.read_text() == before


def test_a_part_of_less_than_half_a_gram_has_a_mass(product: Path) -> None:
    file = written(product.parent / "bead.stl", BEAD)
    assert main(["new", "part", str(file), "--product", str(product)]) == 0
    assert load_yaml(product, Product).parts["bead"].mass_kg == pytest.approx(2700 * 150e-9, rel=0.01)


def test_a_shape_that_makes_no_legal_product_is_taken_back(
    product: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written(product.parent / "block.stl", BLOCK)
    assert main(["new", "part", str(file), "--product", str(product)]) == 0
    before = {path.name: path.read_bytes() for path in product.parent.iterdir()}

    def refuse(path: Path, model: type[Product]) -> Product:
        if "partial" in path.name:
            raise InputError("parts.block: no legal product")
        return usual(path, model)

    usual = load_yaml
    monkeypatch.setattr("bracket_cell.commands.new.load_yaml", refuse)
    assert main(["new", "part", str(file), "--product", str(product), "--stance", "2"]) == 2
    assert "stays as it was: with what was to be written it is not legal: parts.block" in capsys.readouterr().err
    assert {path.name: path.read_bytes() for path in product.parent.iterdir()} == before
