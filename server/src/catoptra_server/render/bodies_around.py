"""How near bodies come in each ring of the image, and how fast those that move pass by.

Bodies are asked by the boxes around a few dozen of their triangles each: they move from frame to
frame, so that nothing of the answer can be kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.scene_summary import RINGS
from catoptra_server.render.chunks import make_chunks
from catoptra_server.render.rings import Rings, box_bounds
from catoptra_server.scene.bodies import Body, BodyMesh

_TRIANGLES_A_BOX = 32


@dataclass(frozen=True, slots=True, eq=False)
class Around:
    """(RINGS,) of each: distances within which no body is shown, and the rates of passing by."""

    nearest_m: Floats
    passing_rad_s: Floats


class BodiesAround:
    """The boxes of all meshes that bodies had so far, in their frames."""

    def __init__(self) -> None:
        self._boxes: dict[BodyMesh, tuple[Floats, Floats]] = {}

    def of(self, bodies: tuple[Body, ...], viewpoint: Floats, turn: Floats, rings: Rings) -> Around:
        """Return what bodies are to a (3,) viewpoint; turn: (3, 3) to axes with the mirror's z."""
        nearest, passing = np.full(RINGS, np.inf), np.zeros(RINGS)
        for body in bodies:
            bounds = self._bounds(body, viewpoint, turn, rings)
            nearest = np.minimum(nearest, bounds)
            speed_m_s = _largest_speed_m_s(body)
            if speed_m_s > 0.0:
                passing = np.maximum(passing, speed_m_s / np.maximum(bounds, 1e-6))
        return Around(nearest, passing)

    def _bounds(self, body: Body, viewpoint: Floats, turn: Floats, rings: Rings) -> Floats:
        middles, halves = self._boxes_of(body.mesh)
        axes = turn @ body.world_from_body.rotation
        middle = middles @ axes.T + turn @ (body.world_from_body.translation - viewpoint)
        half = halves @ np.abs(axes).T
        bounds: Floats = box_bounds(middle - half, middle + half, rings).min(axis=0)
        return bounds

    def _boxes_of(self, mesh: BodyMesh) -> tuple[Floats, Floats]:
        if mesh not in self._boxes:
            group = np.zeros(len(mesh), dtype=np.intp)
            chunks = make_chunks(mesh.corners, group, size=_TRIANGLES_A_BOX)
            self._boxes[mesh] = (0.5 * (chunks.low + chunks.high), 0.5 * (chunks.high - chunks.low))
        return self._boxes[mesh]


def _largest_speed_m_s(body: Body) -> float:
    """Return a speed that no point of a body exceeds in the world: that of the sphere around it."""
    middle = body.twist.at(body.centre - body.world_from_body.translation)
    turning = float(np.linalg.norm(body.twist.angular_rad_s)) * body.mesh.radius_m
    return middle.speed_m_s + turning
