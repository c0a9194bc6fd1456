"""Small worlds that the renderers' tests share, and cameras in them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from PIL import Image

from catoptra_protocol.optics.mirrors import PAPER_MIRROR, Mirror
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.plan.faces import face_regions
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.renderer import (
    FaceRegion,
    MirrorSurface,
    PerPixel,
    RenderPlan,
    RenderSettings,
)
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.objects import CameraState
from catoptra_server.world.panorama import Panorama, make_panorama, texel_directions
from catoptra_server.world.world_description import (
    Box,
    Cylinder,
    DirectionalLight,
    HemisphereLight,
    Item,
    Light,
    Material,
    PointLight,
    Rectangle,
    World,
)

HEMISPHERE_LIGHT = HemisphereLight((0.7, 0.7, 0.7), (0.3, 0.3, 0.3))
DIRECTIONAL_LIGHT = DirectionalLight((0.28, 0.19, -0.94), (0.4, 0.4, 0.4))
POINT_LIGHT = PointLight((0.4, -0.5, -1.4), (0.9, 0.7, 0.4))
# 0.6 m over the floor, off every axis and turned, so that nothing lines up by accident.
CAMERA_STATE = CameraState(Pose.from_rpy((0.31, 0.17, -0.6), (0.02, -0.03, 0.3)))


def make_test_world(
    *,
    lights: tuple[Light, ...] = (HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT),
    texture: Path | None = None,
) -> World:
    """A floor with boxes and a post on it, under an open sky of constant radiance."""
    items = (
        Item(
            "floor", Rectangle((6, 4), (3, 2)), Pose.identity(), Material((0.3, 0.35, 0.3), texture)
        ),
        Item(
            "wall",
            Box((0.1, 3.0, 1.2)),
            _pose_on_floor(1.6, 0.2, -0.6, 0.2),
            Material((0.6, 0.5, 0.2)),
        ),
        Item(
            "crate",
            Box((0.4, 0.3, 0.5)),
            _pose_on_floor(-0.9, -0.8, -0.25, 0.5),
            Material((0.5, 0.1, 0.1)),
        ),
        Item(
            "post",
            Cylinder(0.1, 1.0),
            _pose_on_floor(0.0, 1.1, -0.5, 0.0),
            Material((0.1, 0.3, 0.7)),
        ),
        Item(
            "panel",
            Box((0.5, 0.5, 0.02)),
            _pose_on_floor(0.3, -1.3, -0.9, 0.0),
            Material((0.9, 0.2, 0.8), unlit=True),
        ),
    )
    return World("room", items, lights=lights, background=(0.3, 0.3, 0.35))


def make_smooth_sky(size: int = 256) -> Panorama:
    """A sky of other light in each direction, up to 4, without symmetry."""
    x, y, z = np.moveaxis(texel_directions(size), -1, 0)
    waves = [2.0 + np.sin(3.0 * x + i) + np.cos(2.0 * y - 4.0 * z + i) for i in range(3)]
    return make_panorama(0.25 * np.stack(waves, axis=-1) ** 2)


def under_sky(world: World, sky: Panorama) -> World:
    """The world under a sky."""
    return replace(world, sky=sky, background=sky.mean)


def translate_world(world: World, offset_m: tuple[float, float, float]) -> World:
    """The world with all its items, not its lights, moved by an offset."""
    offset = Pose.from_rpy(offset_m)
    items = (replace(item, world_from_item=offset @ item.world_from_item) for item in world.items)
    return replace(world, items=tuple(items))


def _pose_on_floor(x: float, y: float, z: float, yaw_rad: float) -> Pose:
    return Pose.from_rpy((x, y, z), (0.0, 0.0, yaw_rad))


def write_smooth_texture(path: Path, *, size: int = 64) -> Path:
    """Write an image file whose colours vary slowly and repeat without a step; return its path."""
    wave = 2.0 * math.pi * (np.arange(size) + 0.5) / size
    u, v = np.meshgrid(wave, wave)
    levels = 128.0 + 80.0 * np.stack((np.sin(u), np.cos(v), np.sin(u + v)), axis=-1)
    Image.fromarray(np.rint(levels).astype(np.uint8)).save(path)
    return path


def write_fine_texture(path: Path) -> Path:
    """Write an image file of odd sides, checkers of 2 px with coarse spots; return its path."""
    rows, columns = np.mgrid[:45, :61]
    grey = (
        90 + 100 * ((rows // 2 + columns // 2) % 2) + 60 * (np.hypot(rows - 20, columns - 30) < 9)
    )
    Image.fromarray(np.stack((grey, 250 - grey, grey // 2), axis=-1).astype(np.uint8)).save(path)
    return path


def make_fine_floor(texture: Path) -> World:
    """A floor to the horizon: from a camera 0.6 m above, its texture is finer than any pixel, far
    away at grazing angles."""
    material = Material((0.9, 0.85, 0.8), texture)
    floor = Item("floor", Rectangle((40, 30), (100, 100)), Pose.identity(), material)
    return World("fine floor", (floor,), lights=(HEMISPHERE_LIGHT, DIRECTIONAL_LIGHT))


def make_omni_camera(
    *, mirror: Mirror = PAPER_MIRROR, width_px: int = 200, rim_deg: float = 120.0
) -> OmniCamera:
    """A square camera whose rim touches the image borders."""
    return camera_with_inscribed_rim(
        mirror, width_px=width_px, height_px=width_px, rim_rad=math.radians(rim_deg)
    )


def make_plan(
    camera: OmniCamera,
    surface: MirrorSurface = PerPixel(),  # noqa: B008 - frozen
    *,
    samples: int = 1,
    face_size_px: int = 0,
    face_samples: int = 1,
) -> RenderPlan:
    """A plan of explicit numbers for the raster renderer; trace ignores the faces."""
    render_settings = RenderSettings(surface, samples, face_size_px, face_samples)
    return plan_from_settings(render_settings, camera, kind=RendererKind.RASTER, reason="test")


def regions_of_size(max_incidence_rad: float, size_px: int) -> tuple[FaceRegion, ...]:
    """Regions of all visible faces, with `size_px` texels for 90 degrees, for any camera."""
    camera = make_omni_camera()
    return face_regions(camera, max_incidence_rad, size_px=size_px, texels_per_px=1.0)
