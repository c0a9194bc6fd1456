"""Summary of a scene for the effects' criteria: bounds on everything a frame can show."""

from __future__ import annotations

import math

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.world.world_description import AT_REST, Twist, Vector3

# Rings of equal width from the image centre to a mirror's rim or a lens's corners. Distances differ
# by ring: the floor below the robot is near, the surroundings at the rim are far.
NUM_RINGS = 8


@dataclass(frozen=True, slots=True)
class ShadowLoss:
    """Change of the surface whose encoded value changes most in shadow."""

    lost_radiance: float = 0.0
    """Radiance of the lights that can be occluded."""
    remaining_radiance: float = 0.0
    """Radiance of all other light."""


NO_SHADOW_LOSS = ShadowLoss()


# Defaults are the values of a scene without anything near, moving or casting shadows, so a summary
# of radiance alone is `SceneSummary(max_radiance)`.
@dataclass(frozen=True, slots=True)
class SceneSummary:
    """Bounds on everything a frame can show. Hashable: equal summaries give equal decisions.

    Every number is a bound, none an estimate. Criteria declare the fields that they read.
    """

    max_radiance: float
    """Largest radiance of any colour; 1 fills a pixel's well.

    The smallest is 0 without a field: outside the mirror every image is black.
    """
    min_distances_m: tuple[float, ...] = (math.inf,) * NUM_RINGS
    """Distance from the effective viewpoint to the nearest of scene and dynamic objects, by ring.

    Only of surfaces that move relative to the camera; see `attached_min_distances_m`.
    """
    max_distance_m: float = math.inf
    """Distance of the farthest surface."""
    background_radiance: Vector3 | None = None
    """Linear RGB where there is no surface; None if unknown."""
    scene_twist: Twist = AT_REST
    """Motion of the scene relative to the camera, at the viewpoint, in axes whose z is the optical
    axis: the mirror frame."""
    max_object_rates_rad_s: tuple[float, ...] = (0.0,) * NUM_RINGS
    """Largest angular rate of dynamic objects about the viewpoint, by ring, beside the twist."""
    max_shadow_loss: ShadowLoss = NO_SHADOW_LOSS
    """Largest loss in the shadow of scene and dynamic objects."""
    max_shadow_loss_with_ego_body: ShadowLoss = NO_SHADOW_LOSS
    """Largest loss where the robot that carries the camera casts shadows, too."""
    camera_key: tuple[int, int] | None = None
    """Key of the camera's own patterns (`NoiseSeed.camera_key`); None if unknown."""
    ego_body_max_radiance: float = 0.0
    """Largest radiance of the ego body."""
    ego_body_max_angle_rad: float = 0.0
    """Largest angle between the optical axis and the ego body; 0 if none of it is in view."""
    ego_body_min_distances_m: tuple[float, ...] = (math.inf,) * NUM_RINGS
    """Distance from the viewpoint to the nearest visible point of the ego body, by ring."""
    attached_min_distances_m: tuple[float, ...] = (math.inf,) * NUM_RINGS
    """Distance to the nearest surface that moves with the camera, by ring.

    Infinite until `SelfView` is enabled; such surfaces blur by defocus but not by motion.
    """
    included_effects: frozenset[tuple[str, str]] = frozenset()
    """Pairs of an effect and of the enabled effect that does its work as well, by name."""

    @property
    def visible_min_distances_m(self) -> tuple[float, ...]:
        """Distance to the nearest visible surface, by ring, however that surface moves."""
        return tuple(map(min, self.min_distances_m, self.attached_min_distances_m))
