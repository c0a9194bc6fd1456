"""Lights of world files, in linear light."""

from __future__ import annotations

import numpy as np

from catoptra_server.config.section_reader import SectionReader
from catoptra_server.config.world_values import read_colour, read_position
from catoptra_server.world.world_description import (
    DirectionalLight,
    HemisphereLight,
    Light,
    PointLight,
    Rgb,
)


def read_light(struct: SectionReader) -> Light:
    """Light of one struct: a hemisphere, a direction or a point."""
    brightness = struct.get_float("Brightness", 1.0, min_value=0.0, max_value=1e6)

    def read_radiance(key: str, default: tuple[int, int, int]) -> Rgb:
        # Brightness scales linear light, after decoding: 2 is twice the radiance.
        r, g, b = read_colour(struct, key, default)
        return brightness * r, brightness * g, brightness * b

    match struct.get_choice("Type", ["Hemisphere", "Directional", "Point"]):
        case "Hemisphere":
            return HemisphereLight(
                read_radiance("Up", (255, 255, 255)), read_radiance("Down", (128, 128, 128))
            )
        case "Directional":
            direction = np.asarray(struct.get_vector("Direction"))
            length = float(np.linalg.norm(direction))
            if length == 0.0:
                raise struct.make_error("Direction", expected="a direction that is not zero")
            x, y, z = direction / length
            return DirectionalLight(
                (float(x), float(y), float(z)), read_radiance("Colour", (255, 255, 255))
            )
        case _:
            return PointLight(
                read_position(struct, "Position"), read_radiance("Colour", (255, 255, 255))
            )
