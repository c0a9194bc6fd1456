"""Where what is at a pixel at a time was in the sharp picture, tau = 0.

q = p - flow tau + bend tau^2, with the range and the mover of what is at q: one step from those of
p finds them, so that at a border in depth each side keeps its own speed. bend: the way of a spin is
an arc; by how its flow differs a quarter of the duration before and after.

A body comes over pixels that do not show it: its flow is tried where one is found within reach, and
what it carries there lies in front. What it leaves was hidden: then a pixel shows what is on the
way out of the body, and of what hides behind something that stays, its own light.

Domain: twists that stay, turns of up to 10 degrees in the duration (what is left out is of the
third order: 0.04 px at 10 degrees and 320 px from the axis), ways that are short against ranges.
"""

from __future__ import annotations

from typing import Generic

import numpy as np
import numpy.typing as npt

from catoptra_server.effects.effect import Real
from catoptra_server.effects.image_law import WHOLE as WHOLE_PIXEL
from catoptra_server.effects.image_motion import ImageMotion, Scene, Whole

# Where a body is looked for around a pixel, px: a body farther away comes over no pixel, one that
# is thinner than the steps may be missed.
_REACH_PX = (1, 2, 4, 7, 11)
_AROUND = tuple(
    (du * reach, dv * reach)
    for reach in _REACH_PX
    for dv in (-1, 0, 1)
    for du in (-1, 0, 1)
    if du or dv
)


class ImageWays(Generic[Real]):
    """The ways of a frame's motion over a duration, centred on its pose.

    speed_px_s: (h w,) of what a pixel shows, or of a faster body that may come over it; 0 where the
    rim goes through a pixel, which keeps its light.
    """

    def __init__(self, motion: ImageMotion[Real], duration_s: float, dtype: np.dtype[Real]) -> None:
        self.motion: ImageMotion[Real] = motion
        self._duration_s: Real = dtype.type(duration_s)
        every = np.arange(motion.width * motion.height)
        self._front = _fronts(motion) if motion.has_bodies else every
        self.speed_px_s: npt.NDArray[Real] = np.hypot(*motion.flow(every, every))
        coming = np.flatnonzero(self._front != every)
        speed = np.hypot(*motion.flow(coming, self._front[coming]))
        self.speed_px_s[coming] = np.maximum(self.speed_px_s[coming], speed)
        self.speed_px_s[motion.stands < WHOLE_PIXEL] = 0.0

    def to(self, pixels: Whole) -> WaysTo[Real]:
        """Return the ways to (n,) pixels."""
        return WaysTo(self.motion, pixels, self._front[pixels], self._duration_s)


class WaysTo(Generic[Real]):
    """The ways to some pixels, and what does not depend on the time."""

    def __init__(
        self, motion: ImageMotion[Real], pixels: Whole, front: Whole, duration_s: Real
    ) -> None:
        self.pixels = pixels
        self._motion: ImageMotion[Real] = motion
        self._scene: Scene[Real] = motion.of_scene(pixels)
        self._flow: npt.NDArray[Real] = motion.flow(pixels, pixels, self._scene)
        self._bend: npt.NDArray[Real] = _bend(motion, pixels, duration_s)
        self._coming = np.flatnonzero(front != pixels)
        self._front = front[self._coming]
        self._front_flow: npt.NDArray[Real] = motion.flow(pixels[self._coming], self._front)

    def aside(self, tau: npt.NDArray[Real]) -> npt.NDArray[Real]:
        """Return (2, n) px from the pixels to where their content was; tau: seconds, (), (n,)."""
        motion = self._motion
        curve: npt.NDArray[Real] = self._bend * (tau * tau)
        guess = curve - self._flow * tau
        shown = motion.shown_at(self.pixels, guess)
        aside: npt.NDArray[Real] = curve - motion.flow(self.pixels, shown, self._scene) * tau
        if motion.has_bodies:
            self._keep_hidden(aside, guess, shown)
            self._let_come(aside, np.broadcast_to(tau, self.pixels.shape))
        return aside

    def _keep_hidden(
        self, aside: npt.NDArray[Real], guess: npt.NDArray[Real], shown: Whole
    ) -> None:
        """Correct the ways of what does not show where it should have come from."""
        motion = self._motion
        other = np.flatnonzero(motion.mover[shown] != motion.mover[self.pixels])
        pixels, shown = self.pixels[other], shown[other]
        found = motion.shown_at(pixels, aside[:, other])
        hidden = motion.mover[found] != motion.mover[shown]
        left = motion.nearness[shown] < motion.nearness[pixels]
        fallback = np.where(left, guess[:, other], guess.dtype.type(0.0))
        aside[:, other] = np.where(hidden, fallback, aside[:, other])

    def _let_come(self, aside: npt.NDArray[Real], tau: npt.NDArray[Real]) -> None:
        """Correct the ways to pixels that a body comes over."""
        motion, coming = self._motion, self._coming
        pixels, time = self.pixels[coming], tau[coming]
        shown = motion.shown_at(pixels, -self._front_flow * time)
        way = -motion.flow(pixels, shown) * time
        before = motion.shown_at(pixels, aside[:, coming])
        comes = motion.mover[shown] == motion.mover[self._front]
        comes &= motion.mover[motion.shown_at(pixels, way)] == motion.mover[shown]
        comes &= motion.nearness[shown] > motion.nearness[before]
        aside[:, coming] = np.where(comes, way, aside[:, coming])


def _bend(motion: ImageMotion[Real], pixels: Whole, duration_s: Real) -> npt.NDArray[Real]:
    """Return (2, n) px/s^2 that a spin's way departs from a straight line, each by tau^2."""
    way = motion.spin(pixels, pixels) * (duration_s * duration_s.dtype.type(0.25))
    before = motion.spin(motion.shown_at(pixels, way), pixels)
    after = motion.spin(motion.shown_at(pixels, -way), pixels)
    bend: npt.NDArray[Real] = (before - after) / duration_s
    return bend


def _fronts(motion: ImageMotion[Real]) -> Whole:
    """Return the (h w,) pixels whose body may come over each pixel; itself where none is near."""
    shape = (motion.height, motion.width)
    number = np.arange(motion.width * motion.height).reshape(shape)
    front, mover, near = number.copy(), motion.mover.reshape(shape), motion.nearness.reshape(shape)
    nearest = near.copy()
    rows, columns = _around_bodies(mover)
    for du, dv in _AROUND:
        there = np.ix_(
            np.clip(rows + dv, 0, motion.height - 1), np.clip(columns + du, 0, motion.width - 1)
        )
        here = np.ix_(rows, columns)
        found = (mover[there] > 0) & (mover[there] != mover[here]) & (near[there] > nearest[here])
        front[here] = np.where(found, number[there], front[here])
        nearest[here] = np.where(found, near[there], nearest[here])
    return front.reshape(-1)


def _around_bodies(mover: npt.NDArray[np.float32]) -> tuple[Whole, Whole]:
    """Return the rows and the columns within reach of any body."""
    seen = mover > 0
    around = []
    for axis in (1, 0):
        at = np.flatnonzero(seen.any(axis=axis))
        length = mover.shape[1 - axis]
        low, high = (at[0], at[-1] + 1) if at.size else (0, 0)
        reach = _REACH_PX[-1] if at.size else 0
        around.append(np.arange(max(low - reach, 0), min(high + reach, length)))
    return around[0], around[1]
