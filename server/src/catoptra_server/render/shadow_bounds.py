"""The most that shadows can take from a scene: found once, and for bodies where they come.

Of every triangle: what it has of lights that something could hide (`occluders`), point lights from
the nearest place of its box, and what it has left without them. The triangle whose encoded light
would change most speaks for all; textures may darken one by any factor. A body can hide any light
from anything, and is white: it has at most what all lights give it, and at least the dimmer half of
the sky.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.scene_summary import NO_SHADE, Shade
from catoptra_server.render import coarse, shading
from catoptra_server.render.brightness import nearest_irradiance
from catoptra_server.render.lost_light import change_of, greatest_loss
from catoptra_server.render.occluders import hideable_facets
from catoptra_server.render.shading import HideableLight
from catoptra_server.scene.bodies import Body
from catoptra_server.scene.description import DirectionalLight, PointLight, World
from catoptra_server.scene.meshes import SceneMesh

# As near as shading lets a light come, metres.
_NEAREST_M = 1e-3


class ShadowBounds:
    """What exposures of one world can lose."""

    def __init__(self, scene: SceneMesh, world: World) -> None:
        self._scene = scene
        self._lights = shading.hideable_lights(world.lights)
        self._sky = shading.sky_lights(world.lights)

    def of(self, bodies: tuple[Body, ...]) -> Shade:
        """Return the darkest shadow that a scene and bodies could cast."""
        if not self._lights:
            return NO_SHADE
        if not bodies:
            return self._of_scene
        return max((self._where_all_are_hidden, self._on(bodies)), key=change_of)

    @cached_property
    def _of_scene(self) -> Shade:
        """Return what stands hides from what stands: half a second for a million triangles."""
        lost = np.zeros_like(self._scene.albedo)
        left = shading.facet_irradiance(self._sky, self._scene.normals)
        for light in self._lights:
            irradiance = self._irradiance(light)
            is_lost = hideable_facets(self._scene, light)[:, None]
            lost += np.where(is_lost, irradiance, 0.0)
            if isinstance(light, DirectionalLight):
                left += np.where(is_lost, 0.0, irradiance)
        return self._worst(lost, left)

    @cached_property
    def _where_all_are_hidden(self) -> Shade:
        left = shading.facet_irradiance(self._sky, self._scene.normals)
        lost: Floats = sum((self._irradiance(light) for light in self._lights), np.zeros((1, 3)))
        return self._worst(lost, left)

    def _irradiance(self, light: HideableLight) -> Floats:
        """Return (n, 3): at most what a light gives each triangle."""
        if isinstance(light, PointLight):
            return nearest_irradiance(self._scene.corners, light)[0]
        return shading.facet_irradiance((light,), self._scene.normals)

    def _worst(self, lost: Floats, left: Floats) -> Shade:
        """Return the loss of light that changes a triangle's picture most, of (n, 3) irradiance."""
        lit = self._scene.albedo * ~self._scene.unlit[:, None]
        return greatest_loss(lost * lit, left * lit, can_be_darker=self._scene.texture_index >= 0)

    def _on(self, bodies: tuple[Body, ...]) -> Shade:
        """Return what white bodies can lose, however they are turned."""
        left, lost = np.zeros(3), np.zeros(3)
        for sky in self._sky:
            left += np.minimum(sky.up, sky.down)
        for light in self._lights:
            if isinstance(light, PointLight):
                nearest = coarse.down([_nearest_m(light, bodies)])[0]
                lost += np.asarray(light.intensity) / max(nearest, _NEAREST_M) ** 2
            else:
                lost += np.asarray(light.irradiance)
        return greatest_loss(lost[None], left[None], can_be_darker=np.array([True]))


def _nearest_m(light: PointLight, bodies: tuple[Body, ...]) -> float:
    at = np.asarray(light.position_m)
    return min(float(np.linalg.norm(at - body.centre)) - body.mesh.radius_m for body in bodies)
