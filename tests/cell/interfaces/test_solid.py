"""Solids reach where their surface is, and a shape that does not fit its part is refused with its line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bracket_ground.errors import InputError, Problem
from bracket_ground.files.yaml_file import load_yaml
from bracket_ground.interfaces.pose import Array
from bracket_ground.interfaces.product import Product
from bracket_ground.interfaces.solid import Solid, span_m

CONFIG = Path(__file__).parents[3] / "config"
SOLIDS = [
    Solid(solid="box", size_m=(0.02, 0.03, 0.05), centre_m=(0.01, -0.02, 0.04)),
    Solid(solid="cylinder", size_m=(0.02, 0.03, 0.03), centre_m=(0.0, 0.01, 0.02), axis="x"),
    Solid(solid="cylinder", size_m=(0.03, 0.02, 0.03), centre_m=(0.0, 0.01, 0.02), axis="y"),
    Solid(solid="cylinder", size_m=(0.03, 0.03, 0.02), centre_m=(0.0, 0.01, 0.02)),
    Solid(solid="ball", size_m=(0.03, 0.04, 0.02), centre_m=(0.0, 0.01, 0.02)),
    Solid.hull(np.array([(0.0, 0.0, 0.0), (0.04, 0.0, 0.0), (0.0, 0.03, 0.0), (0.01, 0.01, 0.05), (0.03, 0.02, 0.03)])),
]


def inside(solid: Solid, points: Array) -> NDArray[np.bool_]:
    """Whether points (n, 3) are in a solid, by its definition."""
    scaled = np.abs(points - solid.centre_m) / (np.array(solid.size_m) / 2)
    if solid.solid == "box":
        return np.asarray((scaled <= 1).all(axis=1))
    if solid.solid == "hull":
        away = points @ solid.faces.normals.T - (solid.faces.normals * solid.faces.corners_m[:, 0]).sum(axis=1)
        return np.asarray((away <= 0).all(axis=1))
    if solid.solid == "ball":
        return np.asarray((scaled**2).sum(axis=1) <= 1)
    across = [axis for axis in range(3) if axis != "xyz".index(solid.axis)]
    return np.asarray(((scaled[:, across] ** 2).sum(axis=1) <= 1) & (scaled[:, "xyz".index(solid.axis)] <= 1))


@pytest.mark.parametrize("solid", SOLIDS)
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_span_is_how_far_the_solid_reaches_in_the_window(solid: Solid, axis: int) -> None:
    rng = np.random.default_rng(axis)
    first, second = (index for index in range(3) if index != axis)
    for _ in range(20):
        windows = {}
        for index in (first, second):
            middle = solid.centre_m[index] + rng.uniform(-0.6, 0.6) * solid.size_m[index]
            windows[index] = (middle - 0.001, middle + 0.001)
        points = rng.uniform(-0.5, 0.5, (40000, 3)) * solid.size_m + np.array(solid.centre_m)
        for index, (low, high) in windows.items():
            points[:, index] = rng.uniform(low, high, len(points))
        found = points[inside(solid, points), axis]
        span = solid.span_m(axis, windows)
        if len(found) > 20:
            assert span is not None
            assert span[0] - 1e-12 <= found.min() < span[0] + 0.002
            assert span[1] - 0.002 < found.max() <= span[1] + 1e-12
        elif len(found) == 0:
            assert span is None or span[1] - span[0] < 0.35 * solid.size_m[axis]


@pytest.mark.parametrize("solid", SOLIDS)
def test_points_lie_on_the_surface_and_reach_all_sides(solid: Solid) -> None:
    points = solid.points()
    middle = np.array(solid.centre_m)
    assert inside(solid, middle + (points - middle) * 0.9999).all()
    assert not inside(solid, middle + (points - middle) * 1.0001).any()
    half = np.array(solid.size_m) / 2
    np.testing.assert_allclose([points.min(axis=0), points.max(axis=0)], [middle - half, middle + half], atol=1e-12)


def test_solids_together_reach_as_far_as_the_farthest() -> None:
    assert span_m(SOLIDS[:2], 0) == pytest.approx((-0.01, 0.02))
    assert span_m(SOLIDS, 2, {0: (0.1, 0.2)}) is None
    assert span_m((), 0) is None


def test_a_plain_box_is_what_a_part_without_a_shape_is() -> None:
    product = load_yaml(CONFIG / "products.yaml", Product)
    data = product.parts["o2"].model_dump()
    shapes: tuple[object, ...] = ("box", [])
    for shape in shapes:
        kind = type(product.parts["o2"]).model_validate(data | {"shape": shape})
        assert kind.shape == ()
        assert [span_m(kind.solids, axis) for axis in range(3)] == [(-0.0325, 0.0325), (-0.017, 0.017), (0.0, 0.045)]
        assert kind.alike_after_half_turn


def test_two_ends_that_differ_are_known() -> None:
    kind = load_yaml(CONFIG / "products.yaml", Product).parts["o3"]
    assert kind.alike_after_half_turn
    *others, lever = kind.model_dump()["shape"]
    lopsided = kind.model_dump() | {"shape": [*others, lever | {"centre_m": (0.005, 0.0, 0.068)}]}
    assert not type(kind).model_validate(lopsided).alike_after_half_turn


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("size_m: [0.065, 0.034, 0.045]", "size_m: [0.070, 0.034, 0.045]", "along x, but size_m says"),
        ("solid: ball", "solid: cone", "'box', 'cylinder', 'ball' or 'hull'"),
        ("size_m: [0.034, 0.034, 0.005]", "size_m: [0.034, 0.030, 0.005]", "as wide one way as the other"),
        ("size_m: [0.034, 0.034, 0.005]", "size_m: [0.034, 0.034, -0.005]", "greater than 0"),
        ("shade: 0.7} # handwheel", "shade: 7} # handwheel", "shade"),
        ("axis: x} # pipe", "axes: x} # pipe", "did you mean 'axis'"),
    ],
)
def test_a_shape_that_cannot_be_is_refused_with_its_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    text = (CONFIG / "products.yaml").read_text()
    at = text.index("o2:")
    path = tmp_path / "mine.yaml"
    path.write_text(text[:at] + text[at:].replace(old, new, 1))
    with pytest.raises(InputError) as caught:
        load_yaml(path, Product)
    first = caught.value.problems[0]
    assert isinstance(first, Problem)
    assert said in str(first)
    begins = text[:at].count("\n") + 1
    assert begins <= (first.place.line or 0) <= begins + 17


def test_a_shape_that_is_a_wrong_word_is_refused(tmp_path: Path) -> None:
    text = (CONFIG / "products.yaml").read_text()
    at = text.index("    shape:")
    end = text.index("  o2:")
    path = tmp_path / "mine.yaml"
    path.write_text(text[:at] + "    shape: sphere\n" + text[end:])
    with pytest.raises(InputError, match="must be 'box' or a list of solids"):
        load_yaml(path, Product)


def test_the_steel_product_is_the_same_but_for_its_finish() -> None:
    painted, steel = (load_yaml(CONFIG / name, Product) for name in ("products.yaml", "products_steel.yaml"))
    look = {"colour_rgb", "finish"}
    assert {name: part.model_dump(exclude=look) for name, part in painted.parts.items()} == {
        name: part.model_dump(exclude=look) for name, part in steel.parts.items()
    }
    assert (painted.bracket, painted.goals) == (steel.bracket, steel.goals)
    assert {part.finish for part in steel.parts.values()} == {"steel"}
    assert all(max(part.colour_rgb) - min(part.colour_rgb) < 0.05 for part in steel.parts.values())
