"""The passes of a frame follow from ranges and shutter; passes without a use do not exist."""

from __future__ import annotations

import dataclasses

import pytest

from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.world.camera_state import FogMedium, Shutter
from catoptra_server.world.scene_mesh import build_scene
from helpers.effect_measurement import CAMERA, make_effect
from helpers.worlds import CAMERA_STATE, make_plan, make_test_world

FOG = FogMedium(0.1, (0.5, 0.5, 0.5))
SHUTTER = Shutter(exposure_s=0.02, readout_s=0.0, num_steps=2.0)


@pytest.mark.parametrize(
    ("effects", "fog", "shutter", "names"),
    [
        ((), None, None, ("faces", "mirror")),
        (("Vignetting",), None, None, ("faces", "mirror")),
        ((), FOG, None, ("faces", "mirror")),
        ((), None, SHUTTER, ("accumulate", "encode")),
        ((), FOG, SHUTTER, ("accumulate", "encode")),
    ],
)
def test_passes_when_rendered_are_those_of_effects_and_shutter_and_none_of_fog(
    device: GlDevice,
    effects: tuple[str, ...],
    fog: FogMedium | None,
    shutter: Shutter | None,
    names: tuple[str, ...],
) -> None:
    world = make_test_world()
    renderer = RasterRenderer(build_scene(world), world, device=device)
    view = renderer.prepare(CAMERA, make_plan(CAMERA))
    camera_state = dataclasses.replace(CAMERA_STATE, fog=fog, shutter=shutter)
    view.render(camera_state, tuple(make_effect(name) for name in effects))
    assert view.pass_names == names
    view.close()
