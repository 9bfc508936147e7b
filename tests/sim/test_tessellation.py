"""Cylinders as meshes look as MuJoCo's own, and change no mass."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from bracket_ground.interfaces.bench import Bench
from bracket_ground.interfaces.product import Product
from bracket_sim.rendering.studio import Studio
from bracket_sim.scene import world as worlds
from bracket_sim.scene.parts import cylinder
from bracket_sim.scene.world import World, build_world


def plain(product: Product, bench: Bench, monkeypatch: pytest.MonkeyPatch) -> World:
    with monkeypatch.context() as patched:
        patched.setattr(worlds, "simplify_cylinders", lambda _: None)
        return build_world(product, bench)


def seen(world: World) -> NDArray[np.int64]:
    studio = Studio(world)
    try:
        return studio.render("overhead", 480, 360).astype(int)
    finally:
        studio.close()


def test_hardly_a_pixel_changes(product: Product, bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    off = np.abs(seen(plain(product, bench, monkeypatch)) - seen(build_world(product, bench))).max(axis=2)
    assert (off > 0).mean() < 1e-3
    assert (off > 1).mean() < 1e-4


def test_bodies_keep_mass_and_inertia(product: Product, bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    before, after = plain(product, bench, monkeypatch).model, build_world(product, bench).model
    assert after.ngeom > before.ngeom
    for name in ("body_mass", "body_inertia", "body_ipos", "dof_invweight0"):
        np.testing.assert_array_equal(getattr(before, name), getattr(after, name))


def test_a_cylinder_is_closed_and_its_normals_point_outwards() -> None:
    points, normals, triangles = cylinder(0.02, 0.03)
    a, b, c = points[triangles].transpose(1, 0, 2)
    across = np.cross(b - a, c - a)
    assert ((across * normals[triangles].mean(axis=1)).sum(axis=1) > 0).all()
    np.testing.assert_allclose(across.sum(axis=0), 0, atol=1e-12)


def test_the_floor_is_drawn_only_where_a_camera_looks_past_the_table(product: Product, bench: Bench) -> None:
    world = build_world(product, bench)
    studio = Studio(world)
    assert not studio._past_table("overhead", 4 / 3)
    world.data.cam_xpos[world.model.camera("overhead").id] += (1.0, 0.0, 0.0)
    assert studio._past_table("overhead", 4 / 3)
