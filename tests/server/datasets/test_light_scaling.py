"""Lights scaled by a factor."""

from __future__ import annotations

import pytest

from catoptra_server.datasets.sample_renderer import scale_lights
from catoptra_server.world.world_description import (
    DirectionalLight,
    HemisphereLight,
    PointLight,
    World,
)


def test_all_lights_are_brighter_by_the_factor_and_nothing_else_changes() -> None:
    lights = (
        HemisphereLight((0.5, 0.25, 0.125), (0.0, 1.0, 2.0)),
        DirectionalLight((0.0, 0.0, 1.0), (1.0, 2.0, 4.0)),
        PointLight((1.0, 2.0, -3.0), (8.0, 0.0, 1.0)),
    )
    world = World("w", (), lights=lights, background=(0.5, 0.5, 0.5))
    scaled = scale_lights(world, 2.0)
    assert scaled.lights == (
        HemisphereLight((1.0, 0.5, 0.25), (0.0, 2.0, 4.0)),
        DirectionalLight((0.0, 0.0, 1.0), (2.0, 4.0, 8.0)),
        PointLight((1.0, 2.0, -3.0), (16.0, 0.0, 2.0)),
    )
    assert scaled.background == world.background
    assert scale_lights(world, 1.0) is world


def test_factor_zero_is_darkness() -> None:
    world = World("w", (), lights=(DirectionalLight((0.0, 0.0, 1.0), (1.0, 1.0, 1.0)),))
    (light,) = scale_lights(world, 0.0).lights
    assert isinstance(light, DirectionalLight)
    assert light.irradiance == pytest.approx((0.0, 0.0, 0.0))
