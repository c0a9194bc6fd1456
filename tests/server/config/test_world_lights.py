"""Lights of world files."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_server.config.world_file import read_world
from catoptra_server.world.world_description import (
    DirectionalLight,
    HemisphereLight,
    PointLight,
)
from helpers.configs import write_small_world


def test_lights_when_written_are_linear_light_times_brightness(tmp_path: Path) -> None:
    world, _ = read_world(
        write_small_world(
            tmp_path,
            "Lights=(Type=Hemisphere,Up=(R=255,G=255,B=255),Down=(R=0,G=0,B=0),Brightness=0.5)",
            "Lights=(Type=Directional,Direction=(X=0,Y=0,Z=2))",
            "Lights=(Type=Point,Position=(X=1,Y=2,Z=-3),Colour=(R=255,G=0,B=0),Brightness=4)",
        )
    )
    assert world.lights == (
        HemisphereLight((0.5, 0.5, 0.5), (0.0, 0.0, 0.0)),
        DirectionalLight((0.0, 0.0, 1.0), (1.0, 1.0, 1.0)),
        PointLight((1.0, 2.0, -3.0), (4.0, 0.0, 0.0)),
    )


def test_direction_when_zero_is_rejected(tmp_path: Path) -> None:
    path = write_small_world(tmp_path, "Lights=(Type=Directional,Direction=(Z=0))")
    with pytest.raises(ConfigError, match=r"Direction=.*a direction that is not zero"):
        read_world(path)
