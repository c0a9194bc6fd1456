from __future__ import annotations

import numpy as np
import pytest

from catoptra_server.render.raster.device import (
    FrameUniforms,
    GlDevice,
    ProgramSpec,
    ShaderPrograms,
)
from catoptra_server.world.world_description import PointLight

LIGHTS = (PointLight((1.0, 2.0, 3.0), (0.1, 0.2, 0.3)),)


def make_uniforms(lights: tuple[PointLight, ...]) -> FrameUniforms:
    viewpoint, origin = np.array([0.5, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    return FrameUniforms.from_viewpoint(viewpoint, (1.0, -2.0), lights=lights, origin=origin)


def test_light_positions_are_relative_to_the_viewpoint() -> None:
    assert make_uniforms(LIGHTS).light_positions.tolist() == [[0.5, 1.0, 3.0]]
    assert make_uniforms(()).light_positions.shape == (0, 3)


@pytest.mark.parametrize("lights", [(), LIGHTS])
def test_programs_with_and_without_lights_accept_their_uniforms(
    device: GlDevice, lights: tuple[PointLight, ...]
) -> None:
    define = (("NUM_POINT_LIGHTS", len(lights)),) if lights else ()
    program = ShaderPrograms(device.context).get(ProgramSpec("face", "face", define))
    make_uniforms(lights).apply_to(program)
    assert program["depth_from_forward"].value == (1.0, -2.0)
