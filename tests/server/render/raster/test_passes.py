from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.raster.device import GlDevice, ShaderPrograms
from catoptra_server.render.raster.passes import LINEAR_DTYPE, AveragePass, OutputImage
from catoptra_server.world.camera_state import CameraState
from catoptra_server.world.world_description import srgb_from_linear

WIDTH, HEIGHT = 5, 3  # an odd width: rows of 15 bytes have no alignment
EXPOSURE = CameraState(Pose.identity())


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_average_is_taken_in_linear_light_and_encoded(device: GlDevice, samples: int) -> None:
    context = device.context
    size = (samples * WIDTH, samples * HEIGHT)
    light = np.random.default_rng(0).uniform(0.0, 1.0, (size[1], size[0], 4)).astype(np.float16)
    image = context.texture(size, 4, light.tobytes(), dtype=LINEAR_DTYPE)
    output = OutputImage(context, WIDTH, HEIGHT)
    AveragePass(context, ShaderPrograms(context), image, samples, output.target).draw(EXPOSURE)
    blocks = light.astype(np.float64).reshape(HEIGHT, samples, WIDTH, samples, 4)
    expected = 255.0 * srgb_from_linear(blocks.mean(axis=(1, 3))[..., :3])
    assert np.abs(output.read() - expected).max() < 0.52  # half a level and the shader's pow


def test_light_beyond_white_counts_in_the_average(device: GlDevice) -> None:
    context = device.context
    light = np.zeros((2, 2, 4), dtype=np.float16)
    light[0, 0] = 4.0
    image = context.texture((2, 2), 4, light.tobytes(), dtype=LINEAR_DTYPE)
    output = OutputImage(context, 1, 1)
    AveragePass(context, ShaderPrograms(context), image, 2, output.target).draw(EXPOSURE)
    assert output.read().tolist() == [[[255, 255, 255]]]


def test_image_when_read_is_a_read_only_copy(device: GlDevice) -> None:
    output = OutputImage(device.context, WIDTH, HEIGHT)
    output.target.clear(1.0, 0.0, 0.0)
    red = output.read()
    output.target.clear(0.0, 1.0, 0.0)
    assert red.shape == (HEIGHT, WIDTH, 3)
    assert (red == (255, 0, 0)).all()
    assert not red.flags.writeable
    output.close()


def test_row_zero_of_the_target_is_the_top_of_the_image(device: GlDevice) -> None:
    output = OutputImage(device.context, WIDTH, HEIGHT)
    output.target.clear()
    output.target.clear(1.0, 1.0, 1.0, viewport=(0, 0, WIDTH, 1))
    assert output.read()[:, 0, 0].tolist() == [255, 0, 0]
    assert device.context.error == "GL_NO_ERROR"
