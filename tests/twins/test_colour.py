"""include/colour.glsl against the float64 transfer function."""

from __future__ import annotations

import moderngl
import numpy as np

from catoptra_server.world.world_description import srgb_from_linear
from helpers.shaders import evaluate_shader


def test_encoding_equals_the_transfer_function(context: moderngl.Context) -> None:
    linear = np.concatenate((np.linspace(-0.1, 1.2, 5001), np.geomspace(1e-7, 1.0, 2000)))
    inputs = np.repeat(linear.astype(np.float32).astype(np.float64)[:, None], 3, axis=1)
    encoded = evaluate_shader(
        context, "srgb_from_linear.frag", include="include/colour.glsl", inputs=(inputs,)
    )
    # A fiftieth of a grey level: drivers approximate pow.
    assert np.abs(encoded[:, :3] - srgb_from_linear(inputs)).max() < 0.02 / 255.0
