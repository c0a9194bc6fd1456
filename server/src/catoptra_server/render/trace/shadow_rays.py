"""Rays to the lights: what stands before a light takes its irradiance from a place.

A ray begins a little in front of its facet, so that the facet itself, where rounding puts the place
behind it, does not hide the light. Facets turned away from a light ask nothing: they are dark.
Float64 twin: the functions of `render/shading`, with every triangle tried.
"""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_server.render import shading
from catoptra_server.render.shading import HideableLight
from catoptra_server.render.trace.embree_scene import EmbreeScene
from catoptra_server.render.trace.moving_bodies import PlacedBody
from catoptra_server.scene.description import Light

# How far in front of a facet rays begin, of the largest coordinate: places and corners are rounded
# to 2^-24 each, and meeting a plane loses a few times that. 40 micrometres at 10 m.
_LIFT = 2.0**-18


class ShadowRays:
    """The lights of a world that can be hidden, and the scene that hides them."""

    def __init__(self, scene: EmbreeScene, lights: tuple[Light, ...]) -> None:
        self._scene = scene
        self._lights = shading.hideable_lights(lights)

    def irradiance(self, points: Floats, normals: Floats, bodies: tuple[PlacedBody, ...]) -> Floats:
        """Return (n, 3) irradiance by all lights that can be hidden, where they are not.

        points: (n, 3) in Embree's coordinates, on facets of (n, 3) unit normals.
        """
        lift = _LIFT * np.abs(points).max(initial=0.0)
        places: Floats = points + lift * normals + self._scene.origin
        total: Floats = np.zeros_like(places)
        for light in self._lights:
            unhidden = shading.light_irradiance(light, places, normals)
            asking = np.flatnonzero(unhidden.any(axis=-1))
            if len(asking):
                seen = asking[~self._hidden(light, places.take(asking, axis=0), bodies)]
                total[seen] += unhidden[seen]
        return total

    def _hidden(
        self, light: HideableLight, places: Floats, bodies: tuple[PlacedBody, ...]
    ) -> Bools:
        """Return (n,) whether something stands between (n, 3) places and a light; world frame."""
        towards, far = shading.towards_light(light, places)
        directions, distance = towards.astype(np.float32), far.astype(np.float32)
        origins = (places - self._scene.origin).astype(np.float32)
        hidden = self._scene.hidden(origins, directions, distance)
        for body in bodies:
            left = np.flatnonzero(~hidden)
            hidden[left] = body.hides(places[left], directions[left], distance[left])
        return hidden
