"""Largest distance of any surface: a box around the scene, spheres around dynamic objects."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.bounds import round_outward
from catoptra_server.world.objects import DynamicObject
from catoptra_server.world.scene_mesh import SceneMesh


class SceneBounds:
    """Axis-aligned box around one scene."""

    def __init__(self, scene: SceneMesh) -> None:
        self._low, self._high = scene.box_min, scene.box_max

    def max_distance_m(self, viewpoint: Floats, objects: tuple[DynamicObject, ...]) -> float:
        """Distance from a (3,) viewpoint beyond which there is no surface, rounded up."""
        of_scene = np.linalg.norm(np.maximum(viewpoint - self._low, self._high - viewpoint))
        # An empty scene has an inverted, infinite box.
        farthest = float(of_scene) if np.isfinite(self._low).all() else 0.0
        for dynamic_object in objects:
            centre_m = float(np.linalg.norm(dynamic_object.centre - viewpoint))
            farthest = max(farthest, centre_m + dynamic_object.mesh.radius_m)
        return round_outward.round_away_from_zero((farthest,))[0]
