from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_protocol.optics.omni_camera import OmniCamera, direction_from_pixel
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.raster.mirror_pass import rim_polygon
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import World
from helpers.worlds import make_omni_camera, make_plan

# Off centre, not square, cut by the image: no part of the mirror may be left out.
OFF_CENTRE = OmniCamera(HyperbolicMirror(11.546, 0.2), 160, 120, (70.0, 66.0), 40.0, 2.0, 0.4)


@pytest.mark.parametrize("camera", [make_omni_camera(), OFF_CENTRE], ids=["centred", "off centre"])
def test_polygon_contains_every_sample_that_sees_the_mirror(camera: OmniCamera) -> None:
    size = np.array((camera.width_px, camera.height_px))
    corners = 0.5 * (rim_polygon(camera) + 1.0) * size
    along = np.roll(corners, -1, axis=0) - corners
    outwards = np.stack((along[:, 1], -along[:, 0]), axis=-1)
    # A pixel is rendered where its centre is inside, and then with all its samples.
    _, seen = direction_from_pixel(camera, pixel_sample_positions(camera, 4))
    centres = pixel_sample_positions(camera)[:, :, 0][seen.any(axis=-1)]
    beyond = np.einsum("pci,ci->pc", centres[:, None] - corners, outwards)
    assert (beyond <= 0.0).all()


def test_more_samples_than_a_texture_contains_are_rejected(device: GlDevice) -> None:
    camera = make_omni_camera(width_px=1100)
    renderer = RasterRenderer(build_scene(World("empty", ())), World("empty", ()), device=device)
    with pytest.raises(DomainError, match=r"16\^2 samples of 1100 x 1100 px are too many"):
        renderer.prepare(camera, make_plan(camera, samples=16, face_size_px=32))


def test_polygon_follows_the_image_centre() -> None:
    camera = make_omni_camera()
    aside = replace(camera, centre_px=(camera.centre_px[0] + 10.0, camera.centre_px[1]))
    shift = rim_polygon(aside) - rim_polygon(camera)
    assert shift == pytest.approx(np.broadcast_to((2.0 * 10.0 / camera.width_px, 0.0), (16, 2)))
