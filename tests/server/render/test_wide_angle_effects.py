"""Effects of a wide-angle lens: both renderers agree, and shading and focus are its own.

What differs from a mirror and from a flat image: the solid angle of a pixel shades the image, the
focus is a sphere, and the picture is right-handed.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.lenses import EquidistantLens, EquisolidLens
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.radial_camera import Picture, RadialProjection
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects import EFFECT_TYPES
from catoptra_server.effects.kernels.lens_blur import Aperture, circle_of_confusion
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.world.objects import CameraState
from catoptra_server.world.world_description import World
from helpers.effect_measurement import make_any_effect
from helpers.renderers import RendererFactory
from helpers.worlds import make_plan
from server.render.test_perspective_effects import (
    NAMES,
    STRONG,
    compare_renderers,
    find_chain,
    plan_always,
)

STILL = CameraState(Pose.identity())
# So few pixels across 220 degrees need a lens of 41 mm for discs of some pixels.
WIDE_OPEN = {"f_number": 1.4, "pixel_pitch_m": 1e-3, "focus_distance_m": 0.4}
STRONGER = STRONG | {"Defocus": WIDE_OPEN, "DefocusByDepth": WIDE_OPEN}


def make_fisheye(
    lens: RadialProjection = EquidistantLens(),  # noqa: B008 - frozen
    *,
    width_px: int = 160,
    field_deg: float = 220.0,
) -> OmniCamera:
    return camera_with_inscribed_rim(
        lens,
        width_px=width_px,
        height_px=width_px,
        rim_rad=math.radians(0.5 * field_deg),
        picture=Picture.FLIPPED,
    )


CAMERA = make_fisheye()


@pytest.mark.parametrize("name", NAMES)
def test_renderers_with_an_effect_agree(device: GlDevice, name: str) -> None:
    raster_plan = make_plan(CAMERA, samples=2, face_size_px=320, face_samples=2)
    smooth, everywhere = compare_renderers(
        device,
        CAMERA,
        find_chain(name, STRONGER),
        prepare_traced=lambda renderer: renderer.prepare(CAMERA, make_plan(CAMERA, samples=2)),
        prepare_rastered=lambda renderer: renderer.prepare(CAMERA, raster_plan),
    )
    assert smooth < 5e-3
    assert everywhere < 0.12


def test_vignetting_is_the_solid_angle_of_each_pixel(make_renderer: RendererFactory) -> None:
    world = World("flat", (), background=(0.5, 0.5, 0.5))
    view = make_renderer(world).prepare(CAMERA, make_plan(CAMERA, samples=1, face_size_px=64))
    plan = plan_always(world, STILL, CAMERA, make_any_effect("Vignetting"))
    image = view.render_linear(STILL, plan.image_effects)[..., 1]
    view.close()
    direction, valid = CAMERA.direction_from_pixel(pixel_sample_positions(CAMERA)[:, :, 0])
    theta = np.arccos(direction[..., 2])
    # Of an equidistant lens: sin(theta) / theta.
    expected = 0.5 * np.sinc(theta / math.pi)
    inside = valid & (np.hypot(*np.meshgrid(*[np.arange(160) - 79.5] * 2)) < 78.0)
    assert image[inside] == pytest.approx(expected[inside], abs=2e-3)


def test_lens_of_equal_solid_angles_has_no_vignetting() -> None:
    camera = make_fisheye(EquisolidLens())
    radius_px = np.linspace(0.0, camera.rim_radius_px, 50)
    assert camera.relative_illumination(radius_px) == pytest.approx(np.ones(50), abs=1e-12)


def test_focus_is_a_sphere() -> None:
    aperture = Aperture(f_number=1.4, pixel_pitch_m=1e-3, focus_distance_m=0.4)
    discs = circle_of_confusion(aperture, CAMERA, np.linspace(0.0, CAMERA.rim_radius_px, 9))
    at_focus = discs.diameter_px(np.full(9, 0.4))
    assert at_focus == pytest.approx(np.zeros(9), abs=1e-9)
    nearer = discs.diameter_px(np.full(9, 0.2))
    assert np.ptp(nearer) == pytest.approx(0.0, abs=1e-9)
    assert abs(nearer[0]) > 1.0


def test_effects_of_mirrors_have_no_place_behind_a_lens() -> None:
    assert {kind.name for kind in EFFECT_TYPES.values() if kind.needs_mirror} == {
        "MirrorDust",
        "MirrorHolder",
        "MirrorReflectance",
        "Misalignment",
        "SelfView",
    }
