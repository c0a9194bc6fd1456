from __future__ import annotations

import pytest

from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.world.scene_mesh import build_scene
from helpers.effect_measurement import CAMERA, DRIVING_STATE
from helpers.worlds import CAMERA_STATE, make_plan, make_test_world


@pytest.mark.parametrize("has_ranges", [False, True])
@pytest.mark.parametrize("has_shutter", [False, True])
def test_exposed_sequence_has_only_the_passes_that_are_needed(
    device: GlDevice, has_ranges: bool, has_shutter: bool
) -> None:
    world = make_test_world()
    view = RasterRenderer(build_scene(world), world, device=device).prepare(
        CAMERA, make_plan(CAMERA)
    )
    with device.context:
        sequence = view.sequences.make_exposure(has_ranges=has_ranges, has_shutter=has_shutter)
        for one in sequence.passes:
            one.draw(DRIVING_STATE if has_shutter else CAMERA_STATE)
        assert sequence.exposure is not None
        light, range_m = sequence.exposure.read()
        num_bytes = sequence.memory_bytes
        sequence.close()
    image_passes = ["accumulate"] if has_shutter else ["faces", "mirror"]
    assert [one.name for one in sequence.passes] == image_passes + ["ranges"] * has_ranges
    assert num_bytes >= 16 * CAMERA.width_px * CAMERA.height_px
    assert light.shape == (CAMERA.height_px, CAMERA.width_px, 3)
    assert light.max() > 0.1
    assert (range_m is not None) == has_ranges
    if range_m is not None:
        assert range_m.shape == light.shape[:2]
    view.close()
