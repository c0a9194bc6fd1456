"""The real camera's defocus against 256 rays a pixel through its aperture, edges included.

What remains is the pixel: an edge within it is blurred as if the whole pixel had its mean. Drawn on
pixels half as wide, the same effect is as near to the aperture as a sharp frame is to 256 rays
through a pinhole. Measured at every ninth pixel both ways with 64 rays a pixel: shares within 2 and
8 grey levels, on whole and on half pixels, and of the sharp frame:

    field      F/4  0.961, 0.986   0.978, 0.998   0.990, 0.999
               F/2  0.957, 0.994   0.979, 1.000
    corridor   F/4  0.988, 1.000   0.998, 1.000   1.000, 1.000
               F/2  0.991, 1.000   0.996, 1.000
    rescue     F/4  0.921, 0.987   0.971, 0.991   0.983, 0.989
               F/2  0.883, 0.986   0.963, 0.992
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.robot_file import read_robot
from catoptra_server.config.world_file import read_world
from catoptra_server.effects.kernels.lens_blur import Aperture
from catoptra_server.effects.medium.defocus import Defocus
from catoptra_server.effects.medium.defocus_by_depth import DefocusByDepth
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import World
from helpers.blur_measurement import inner_pixels
from helpers.image_comparison import grey_levels
from helpers.lens_ray_tracer import focus_lens, render_through_lens
from helpers.worlds import make_plan

PITCH_M = 7.4e-6
POSES = {
    "four_legged_2006": Pose.from_rpy((0.5, 0.3, -0.6), (0.0, 0.0, 0.3)),
    "corridor": Pose.from_rpy((0.5, 0.1, -0.6), (0.0, 0.0, 0.3)),
    "rescue": Pose.from_rpy((0.5, 0.1, -0.6), (0.0, 0.0, 0.3)),
}
# Shares of pixels within 2 and 8 grey levels, on whole pixels and on half ones.
SHARES = {
    ("four_legged_2006", 4.0): ((0.95, 0.98), (0.97, 0.99)),
    ("corridor", 2.0): ((0.98, 0.998), (0.99, 0.998)),
    ("rescue", 4.0): ((0.90, 0.98), (0.95, 0.985)),
}
EVERY_PX = 12


def read_camera() -> OmniCamera:
    robot = read_robot(find_configuration("robots", "p2at_omni_real"))[0]
    assert robot.omni_camera is not None
    return robot.omni_camera.camera


def render_lens(camera: OmniCamera, world: World, pose: Pose, f_number: float) -> Floats:
    lens = focus_lens(camera, Aperture(f_number, PITCH_M, 0.0))
    return render_through_lens(lens, camera, world, pose, stride_px=EVERY_PX)


def split_pixels(camera: OmniCamera, parts: int) -> OmniCamera:
    """The camera with pixels of a part of their width."""
    return replace(
        camera,
        width_px=parts * camera.width_px,
        height_px=parts * camera.height_px,
        centre_px=(parts * camera.centre_px[0], parts * camera.centre_px[1]),
        scale_px=parts * camera.scale_px,
    )


def shares_within(light: Floats, expected: Floats, camera: OmniCamera) -> tuple[float, float]:
    one, other = grey_levels(light), grey_levels(expected)
    inner = inner_pixels(camera, 5.0)[::EVERY_PX, ::EVERY_PX]
    difference = np.abs(one - other).max(axis=-1)[inner]
    return float((difference <= 2.0).mean()), float((difference <= 8.0).mean())


@pytest.mark.parametrize(("name", "f_number"), SHARES)
def test_defocus_of_the_real_camera_is_as_near_to_256_rays_as_is_stated(
    name: str, f_number: float
) -> None:
    camera, world = read_camera(), read_world(find_configuration("worlds", name))[0]
    renderer = TraceRenderer(build_scene(world), world, threads=2)
    expected = render_lens(camera, world, POSES[name], f_number)
    found = []
    for parts, effect in ((1, DefocusByDepth), (2, Defocus)):
        fine = split_pixels(camera, parts)
        # The same rays for both.
        view = renderer.prepare(fine, make_plan(fine, samples=4 // parts))
        lens = Aperture(f_number, PITCH_M / parts, 0.0)
        light = view.render_linear(CameraState(POSES[name]), (effect(lens),)).astype(np.float64)
        shape = (camera.height_px, parts, camera.width_px, parts, 3)
        means = light.reshape(shape).mean(axis=(1, 3))[::EVERY_PX, ::EVERY_PX]
        found.append(shares_within(means, expected, camera))
    renderer.close()
    np.testing.assert_array_less(SHARES[name, f_number], found)
    # The effect on whole pixels is not the last word, and better than none.
    assert found[1][0] > found[0][0]
