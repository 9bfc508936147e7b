"""Places with names: their grids, and what cannot be one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bracket_cell.configuration import load_configuration, load_product
from bracket_ground.errors import InputError
from bracket_ground.interfaces.places import BenchPlace
from tests import ROOT

TENDING = ROOT / "config" / "examples" / "tending"


def test_spots_go_along_x_then_y_around_the_middle() -> None:
    place = BenchPlace(position_m=(0.3, 0.4, 0.02), rows=2, columns=3, pitch_m=(0.1, 0.08))
    assert np.allclose(place.spots_m[:4], [(-0.1, -0.04), (0.0, -0.04), (0.1, -0.04), (-0.1, 0.04)])
    assert place.spot(5).position_m == pytest.approx((0.4, 0.44, 0.02))


def test_a_peg_stands_on_a_flat_place_and_in_a_hole() -> None:
    flat = BenchPlace(position_m=(0.3, 0.4, 0.05))
    hole = BenchPlace(position_m=(0.3, 0.4, 0.05), seat="hole")
    assert flat.stands(0, 0.012).position_m[2] == pytest.approx(0.062)
    assert hole.stands(0, 0.012).position_m[2] == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (("filled: [o1, o2, o2, o1]", "filled: [o1, o2, o2, o1, o1]"), "lists 5 parts for 4 spots"),
        (("filled: [o1, o2, o2, o1]", "filled: [o3]"), "o3 cannot stand there"),
        (("holds: [o1, o2]", "holds: [o9]"), "o9"),
        (("seat: hole", "known_by: felt"), "holds must name one type"),
        (("pitch_m: [0.11, 0.10]", "pitch_m: [0.11, 0.10]\n      known_by: seen"), "seat must be hole"),
        (("seat: hole", "seat: hole\n      known_by: seen"), "camera does not see spot 0"),
        (("enter_from_m: [0.0, -0.18, 0.0]", "enter_from_m: [0.0, -0.18, -0.1]"), "cannot come from below"),
        (
            (
                "position_m: [0.32, 0.68, 0.020]",
                "position_m: [0.32, 0.68, 0.020]\n      quaternion_wxyz: [0.7071, 0.7071, 0, 0]",
            ),
            "slide off",
        ),
        (("    pallet:", "    tray:"), "is a frame already"),
        (("    pallet:", "    p1:"), "is a position of"),
    ],
)
def test_what_cannot_be_a_place_is_refused_with_its_line(tmp_path: Path, change: tuple[str, str], why: str) -> None:
    text = (TENDING / "cell.yaml").read_text().replace("../../products.yaml", str(ROOT / "config" / "products.yaml"))
    file = tmp_path / "cell.yaml"
    file.write_text(text.replace(*change))
    (tmp_path / "sim.yaml").write_bytes((TENDING / "sim.yaml").read_bytes())
    with pytest.raises(InputError, match=why) as refused:
        load_product(load_configuration(file), file)
    assert str(refused.value).startswith(f"{file}:")
