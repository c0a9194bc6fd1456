"""What criteria know of a scene before it is drawn. Every number is a bound, none an estimate."""

from __future__ import annotations

import math
from dataclasses import dataclass

from catoptra_server.scene.twist import AT_REST, Twist, Vector3

# The image is told in so many rings of equal width, from the middle of the mirror to its rim.
NUM_RINGS = 8


@dataclass(frozen=True, slots=True)
class ShadowLoss:
    """Radiance that a surface loses in shadow, and has left: of that which then changes most."""

    lost_radiance: float = 0.0
    remaining_radiance: float = 0.0


NO_SHADOW_LOSS = ShadowLoss()


@dataclass(frozen=True, slots=True)
class SceneSummary:
    """What a frame can show at most. Hashable: equal summaries give equal decisions.

    max_radiance: of any colour; 1 = what fills a pixel's well. The least is 0: beside the
    mirror every picture is black.
    nearest_m: RINGS distances from the effective viewpoint; what a ring shows of the scene and of
    what moves in it is not nearer. attached_min_distances_m: nor is, on top, what moves as the camera does.
    max_distance_m: no surface is farther. background: the light that is seen where there is none; None
    where that is not known.
    motion: of the scene as the camera sees it, told at the viewpoint in the mirror frame.
    max_object_rates_rad_s: at most how fast anything that moves of its own passes by, by ring, on top.
    max_shadow_loss: what a surface can lose where lights with a place or a direction are hidden from
    it; max_shadow_loss_with_ego_body: the same where the robot that carries the camera casts shadows, too.
    ego_body_max_angle_rad: how far from the pole of the image, about the axis, the robot's own body reaches;
    0 where none of it is within the rim. ego_body_min_distances_m: by ring, what is seen of it is not nearer; it
    is attached_min_distances_m once it is shown.
    done: names of effects that one before them does as well: they are left out, whoever asks.
    """

    max_radiance: float
    min_distances_m: tuple[float, ...] = (math.inf,) * NUM_RINGS
    max_distance_m: float = math.inf
    background_radiance: Vector3 | None = None
    scene_twist: Twist = AT_REST
    max_object_rates_rad_s: tuple[float, ...] = (0.0,) * NUM_RINGS
    max_shadow_loss: ShadowLoss = NO_SHADOW_LOSS
    max_shadow_loss_with_ego_body: ShadowLoss = NO_SHADOW_LOSS
    ego_body_max_angle_rad: float = 0.0
    ego_body_min_distances_m: tuple[float, ...] = (math.inf,) * NUM_RINGS
    attached_min_distances_m: tuple[float, ...] = (math.inf,) * NUM_RINGS
    superseded_effects: frozenset[str] = frozenset()

    @property
    def visible_min_distances_m(self) -> tuple[float, ...]:
        """Return RINGS distances; nothing that a ring shows is nearer, however it moves."""
        return tuple(map(min, self.min_distances_m, self.attached_min_distances_m))
