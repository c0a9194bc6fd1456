"""include/omni_camera.glsl and the mirrors' laws against the float64 camera law."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from catoptra_protocol.optics.camera import (
    OmniCamera,
    direction_from_pixel,
    pixel_centres,
    pixel_from_direction,
)
from catoptra_protocol.optics.mirrors import CentralMirror, HyperbolicMirror, ParabolicMirror
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.render.raster.mirror_per_pixel import camera_uniforms, law_of
from helpers.shaders import evaluate
from helpers.worlds import omni_camera

# optics.md 7.4: float32 in the half-angle form is good to 5.5e-5 px at 360 and 5.6e-4 px at 4096.
TOLERANCE_PX = 1e-3

# name, mirror, rim: a rim below the asymptote, which is at 102.6 degrees for k = 2.1.
MIRRORS: list[tuple[str, CentralMirror, float]] = [
    ("nearly a plane", HyperbolicMirror(2.1, 0.2), 100.0),
    ("the paper's", HyperbolicMirror(11.546, 0.2321), 120.0),
    ("the paper's, high rim", HyperbolicMirror(11.546, 0.2321), 150.0),
    ("nearly parabolic", HyperbolicMirror(1e3, 0.2), 120.0),
    ("hardly hyperbolic", HyperbolicMirror(1e6, 0.2), 120.0),
    ("parabolic", ParabolicMirror(0.03), 135.0),
]
CASES = [pytest.param(mirror, rim, id=name) for name, mirror, rim in MIRRORS]


def shader_directions(
    context: moderngl.Context, camera: OmniCamera, pixels: Floats
) -> tuple[Floats, Bools]:
    out = evaluate(
        context,
        "direction_from_pixel.frag",
        include="include/omni_camera.glsl",
        inputs=(pixels,),
        uniforms=camera_uniforms(camera),
        slots={"mirror_law": law_of(camera.mirror)[0]},
    )
    return out[:, :3], out[:, 3] > 0.5


def grid(camera: OmniCamera) -> Floats:
    """Return the pixel centres of every third row and column, and the exact image centre."""
    pixels = pixel_centres(camera)[::3, ::3].reshape(-1, 2)
    return np.concatenate((pixels, [camera.centre_px]))


def largest_error_px(context: moderngl.Context, camera: OmniCamera, pixels: Floats) -> float:
    direction, valid = shader_directions(context, camera, pixels)
    back, inside = pixel_from_direction(camera, direction)
    both = valid & inside
    assert both.mean() > 0.7, "a disc fills more of its square"
    return float(np.linalg.norm(back - pixels, axis=-1)[both].max())


@pytest.mark.parametrize(("mirror", "rim_deg"), CASES)
@pytest.mark.parametrize("width_px", [360, 1024])
def test_direction_over_the_image_returns_to_its_pixel(
    context: moderngl.Context, mirror: CentralMirror, rim_deg: float, width_px: int
) -> None:
    camera = omni_camera(mirror=mirror, width_px=width_px, rim_deg=rim_deg)
    assert largest_error_px(context, camera, grid(camera)) < TOLERANCE_PX


def test_direction_over_a_large_image_returns_to_its_pixel(context: moderngl.Context) -> None:
    camera = omni_camera(width_px=4096)
    assert largest_error_px(context, camera, grid(camera)[::8]) < TOLERANCE_PX


@pytest.mark.parametrize(("mirror", "rim_deg"), CASES)
def test_validity_differs_only_at_the_rim(
    context: moderngl.Context, mirror: CentralMirror, rim_deg: float
) -> None:
    camera = omni_camera(mirror=mirror, width_px=360, rim_deg=rim_deg)
    pixels = grid(camera)
    _, valid = shader_directions(context, camera, pixels)
    _, expected = direction_from_pixel(camera, pixels)
    radius = np.linalg.norm(pixels - camera.centre_px, axis=-1)
    assert np.all(np.abs(radius[valid != expected] - camera.rim_radius_px) < TOLERANCE_PX)


def test_direction_at_the_image_centre_is_the_axis_exactly(context: moderngl.Context) -> None:
    camera = omni_camera()
    direction, valid = shader_directions(context, camera, np.array([camera.centre_px]))
    assert valid.all()
    assert direction.tolist() == [[0.0, 0.0, 1.0]]


def test_direction_follows_the_azimuth_that_points_up(context: moderngl.Context) -> None:
    camera = OmniCamera(HyperbolicMirror(11.546, 0.2), 320, 200, (140.25, 96.5), 60.0, 1.9, 0.7)
    pixels = grid(camera)
    direction, valid = shader_directions(context, camera, pixels)
    expected, _ = direction_from_pixel(camera, pixels)
    unit = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    # A float32 unit vector: 1 ulp in each of a handful of operations.
    assert np.abs(unit - expected)[valid].max() < 1e-6
