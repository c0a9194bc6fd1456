"""How far away anything of a scene can be: the box around it, and spheres around what moves."""

from __future__ import annotations

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.bounds import round_outward
from catoptra_server.scene.dynamic_object import DynamicObject
from catoptra_server.scene.scene_mesh import SceneMesh


class SceneBounds:
    """The box around one scene."""

    def __init__(self, scene: SceneMesh) -> None:
        places = scene.corners.reshape(-1, 3)
        self._low = places.min(axis=0, initial=np.inf)
        self._high = places.max(axis=0, initial=-np.inf)

    def max_distance_m(self, viewpoint: Floats, objects: tuple[DynamicObject, ...]) -> float:
        """Return a distance from a (3,) viewpoint beyond which there is no surface."""
        of_scene = np.linalg.norm(np.maximum(viewpoint - self._low, self._high - viewpoint))
        farthest = float(of_scene) if np.isfinite(self._low).all() else 0.0
        for body in objects:
            middle_m = float(np.linalg.norm(body.centre - viewpoint))
            farthest = max(farthest, middle_m + body.mesh.radius_m)
        return round_outward.round_away_from_zero((farthest,))[0]
