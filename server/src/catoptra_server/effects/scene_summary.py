"""What criteria know of a scene before it is drawn. Every number is a bound, none an estimate."""

from __future__ import annotations

import math
from dataclasses import dataclass

from catoptra_server.scene.motion import AT_REST, Twist, Vector

# The image is told in so many rings of equal width, from the middle of the mirror to its rim.
RINGS = 8


@dataclass(frozen=True, slots=True)
class Shade:
    """Radiance that a surface loses in shadow, and has left: of that which then changes most."""

    lost: float = 0.0
    left: float = 0.0


NO_SHADE = Shade()


@dataclass(frozen=True, slots=True)
class SceneSummary:
    """What a frame can show at most. Hashable: equal summaries give equal decisions.

    largest_radiance: of any colour; 1 = what fills a pixel's well. The least is 0: beside the
    mirror every picture is black.
    nearest_m: RINGS distances from the effective viewpoint; what a ring shows of the scene and of
    what moves in it is not nearer. carried_m: nor is, on top, what moves as the camera does.
    farthest_m: no surface is farther. background: the light that is seen where there is none; None
    where that is not known.
    motion: of the scene as the camera sees it, told at the viewpoint in the mirror frame.
    passing_rad_s: at most how fast anything that moves of its own passes by, by ring, on top.
    largest_shadow: what a surface can lose where lights with a place or a direction are hidden from
    it; own_shadow: the same where the robot that carries the camera casts shadows, too.
    own_body_rad: how far from the pole of the image, about the axis, the robot's own body reaches;
    0 where none of it is within the rim. own_body_m: by ring, what is seen of it is not nearer; it
    is carried_m once it is shown.
    done: names of effects that one before them does as well: they are left out, whoever asks.
    """

    largest_radiance: float
    nearest_m: tuple[float, ...] = (math.inf,) * RINGS
    farthest_m: float = math.inf
    background: Vector | None = None
    motion: Twist = AT_REST
    passing_rad_s: tuple[float, ...] = (0.0,) * RINGS
    largest_shadow: Shade = NO_SHADE
    own_shadow: Shade = NO_SHADE
    own_body_rad: float = 0.0
    own_body_m: tuple[float, ...] = (math.inf,) * RINGS
    carried_m: tuple[float, ...] = (math.inf,) * RINGS
    done: frozenset[str] = frozenset()

    @property
    def in_view_m(self) -> tuple[float, ...]:
        """Return RINGS distances; nothing that a ring shows is nearer, however it moves."""
        return tuple(map(min, self.nearest_m, self.carried_m))
