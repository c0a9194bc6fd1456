"""Worlds under brighter and darker lights."""

from __future__ import annotations

from dataclasses import replace

from catoptra_server.world.world_description import (
    DirectionalLight,
    HemisphereLight,
    Light,
    PointLight,
    Rgb,
    World,
)


def scale_lights(world: World, factor: float) -> World:
    """World whose lights are brighter by a factor; luminous surfaces stay as they are."""
    if factor == 1.0:
        return world
    return replace(world, lights=tuple(_scale_light(light, factor) for light in world.lights))


def _scale_light(light: Light, factor: float) -> Light:
    match light:
        case HemisphereLight():
            return HemisphereLight(
                _scale(light.up_irradiance, factor), _scale(light.down_irradiance, factor)
            )
        case DirectionalLight():
            return replace(light, irradiance=_scale(light.irradiance, factor))
        case PointLight():
            return replace(light, intensity=_scale(light.intensity, factor))


def _scale(colour: Rgb, factor: float) -> Rgb:
    red, green, blue = colour
    return factor * red, factor * green, factor * blue
