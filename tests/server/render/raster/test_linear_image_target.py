from __future__ import annotations

import numpy as np

from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.raster.passes import LinearImageTarget


def test_image_when_read_back_has_its_rows_and_its_light_beyond_white(device: GlDevice) -> None:
    light = np.random.default_rng(7).uniform(0.0, 3.0, (5, 7, 4)).astype(np.float32)
    with device.context as context:
        image = LinearImageTarget(context, 7, 5)
        image.texture.write(light.tobytes())
        np.testing.assert_array_equal(image.read(), light[..., :3])
        assert image.memory_bytes == light.nbytes
        image.close()
