"""The passes of a perspective frame follow from effects and shutter, as a mirror's do."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.world.camera_state import Shutter
from catoptra_server.world.scene_mesh import build_scene
from helpers.effect_measurement import make_effect
from helpers.worlds import CAMERA_STATE, make_test_world

CAMERA = PerspectiveCamera(60, 40, 1.4)
SHUTTER = Shutter(exposure_s=0.02, readout_s=0.0, num_steps=2.0)


@pytest.mark.parametrize(
    ("effects", "shutter", "names"),
    [
        ((), None, ("faces", "average")),
        (("Vignetting",), None, ("faces", "average")),
        (("DefocusByDepth",), None, ("faces", "average", "ranges")),
        ((), SHUTTER, ("accumulate", "encode")),
    ],
)
def test_passes_when_rendered_are_those_of_effects_and_shutter(
    device: GlDevice, effects: tuple[str, ...], shutter: Shutter | None, names: tuple[str, ...]
) -> None:
    world = make_test_world()
    renderer = RasterRenderer(build_scene(world), world, device=device)
    view = renderer.prepare_perspective(CAMERA, 2)
    camera_state = dataclasses.replace(CAMERA_STATE, shutter=shutter)
    view.render(camera_state, tuple(make_effect(name) for name in effects))
    assert view.pass_names == names
    view.close()


def test_linear_light_without_effects_is_what_the_plain_pass_encodes(device: GlDevice) -> None:
    world = make_test_world()
    renderer = RasterRenderer(build_scene(world), world, device=device)
    view = renderer.prepare_perspective(CAMERA, 2)
    light = view.render_linear(CAMERA_STATE)
    assert light.shape == (40, 60, 3)
    plain = view.render(CAMERA_STATE).rgb
    # Brighter pixels have higher codes: rows are not flipped between the two sequences.
    order = np.argsort(light[..., 0].ravel(), kind="stable")
    assert (np.diff(plain[..., 0].ravel()[order].astype(int)) >= -1).all()
    view.close()
