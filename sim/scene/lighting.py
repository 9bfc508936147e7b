"""Lamps of the simulated cell, and the table's pattern."""

from __future__ import annotations

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from sim.scene.look import Light, Surfaces

AIM_M = (0.65, 0.05, 0.0)  # where all lamps shine: the middle of the bench
LAMP_SPECULAR = 0.1
SHADOW_MAP_PX = 1024  # 2.3 mm each, less than a pixel of the overhead camera; twice as many double an image's cost
SHADOWED_M = 1.2  # half the width of what a lamp's shadow map covers
GRAIN_PX = 256
GRAIN_STRETCH = 12  # the pattern is this many times longer than wide, as in wood


def add_lights(spec: mujoco.MjSpec, light: Light) -> None:
    """Soft lamps, whose shadow maps cost more than all the rest of an image; a sky for portraits."""
    headlight = spec.visual.headlight
    headlight.ambient, headlight.diffuse = [light.ambient] * 3, [light.headlight] * 3
    headlight.specular = [0.0] * 3
    spec.visual.quality.shadowsize = SHADOW_MAP_PX
    for number, lamp in enumerate(light.lamps[: light.lamps_n]):
        direction = np.array(AIM_M) - lamp.position_m
        spec.worldbody.add_light(
            pos=list(lamp.position_m),
            dir=list(direction / np.linalg.norm(direction)),
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            diffuse=list(lamp.rgb),
            specular=[LAMP_SPECULAR] * 3,
            ambient=[0.0] * 3,
            castshadow=light.shadows and number == 0,
        )
    spec.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=[0.80, 0.84, 0.88],
        rgb2=[0.45, 0.48, 0.52],
        width=64,
        height=64,
    )


def fit_shadows(model: mujoco.MjModel) -> None:
    """Spend the whole shadow map on the bench."""
    model.vis.map.shadowclip = SHADOWED_M / model.stat.extent


def add_table_material(spec: mujoco.MjSpec, surfaces: Surfaces) -> str:
    """A material with the table's pattern; returns its name, or "" for a plain table."""
    if surfaces.table_grain == 0:
        return ""
    texture = spec.add_texture(
        name="grain", type=mujoco.mjtTexture.mjTEXTURE_2D, width=GRAIN_PX, height=GRAIN_PX, nchannel=3
    )
    texture.data = grain(surfaces).tobytes()
    material = spec.add_material(name="table", rgba=[1.0] * 4, specular=0.2, shininess=0.3, texrepeat=[1, 1])
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "grain"
    return "table"


def grain(surfaces: Surfaces) -> NDArray[np.uint8]:
    """The table's pattern (GRAIN_PX, GRAIN_PX, 3) RGB: streaks around the table's colour."""
    rng = np.random.default_rng(surfaces.grain_number)
    noise = rng.standard_normal((GRAIN_PX, GRAIN_PX)).astype(np.float32)
    streaks = cv2.GaussianBlur(noise, (0, 0), sigmaX=GRAIN_STRETCH, sigmaY=1.0, borderType=cv2.BORDER_REFLECT)
    shade = 1.0 + surfaces.table_grain * streaks[..., np.newaxis] / np.abs(streaks).max()
    pattern: NDArray[np.uint8] = np.rint(np.clip(np.array(surfaces.table_rgb) * shade, 0, 1) * 255).astype(np.uint8)
    return pattern
