from __future__ import annotations

from dataclasses import replace

import numpy as np

from catoptra_server.render.instants import instants
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.context import GlDevice
from catoptra_server.render.renderer import Exposure
from catoptra_server.render.shutter import Shutter
from catoptra_server.scene.meshes import build_scene
from helpers.effects import CAMERA, EXPOSURE, effect_of
from helpers.worlds import raster_plan, room

LASTING = replace(EXPOSURE, shutter=Shutter(0.04, 0.03, 5))


def renderer_on(device: GlDevice) -> RasterRenderer:
    return RasterRenderer(build_scene(room()), room(), device=device)


def mean_of(view: object, exposure: Exposure) -> np.ndarray[tuple[int, int, int]]:
    drawn = (
        view.draw_linear(instant).astype(np.float64) * weights[:, None, None]  # type: ignore[attr-defined]
        for instant, weights in instants(exposure, CAMERA.height_px)
    )
    return sum(drawn, start=np.zeros((CAMERA.height_px, CAMERA.width_px, 3)))


def test_exposure_when_it_lasts_is_the_mean_of_its_instants_by_row(device: GlDevice) -> None:
    view = renderer_on(device).prepare(CAMERA, raster_plan(CAMERA))
    np.testing.assert_allclose(view.draw_linear(LASTING), mean_of(view, LASTING), atol=1e-6)
    view.close()


def test_view_when_an_exposure_lasts_has_one_stage_for_it_and_none_otherwise(
    device: GlDevice,
) -> None:
    renderer = renderer_on(device)
    view = renderer.prepare(CAMERA, raster_plan(CAMERA))
    view.draw(EXPOSURE)
    assert view.passes == ("faces", "mirror")
    assert not [name for name in renderer.programs_built if "weigh" in name]
    effects = (effect_of("Vignetting"),)
    assert tuple(view.draw(LASTING, effects).stage_ms) == (
        "instants",
        "Vignetting",
        "encode",
        "readback",
    )
    view.close()
