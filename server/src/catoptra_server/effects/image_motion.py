"""How fast what each pixel shows moves through the picture.

A point at a range D and in the direction d, whose mover has the twist (v, w), is seen to move by
flow = slide / D + spin px/s, slide = J v, spin = J (w x d), J the law of `image_law`. Where nothing
is met only spin is left. What each pixel shows is the geometry's: that of its middle.
"""

from __future__ import annotations

from typing import Generic

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.effects.capture import SCENE, Capture
from catoptra_server.effects.effect import Real, Uniforms
from catoptra_server.effects.image_law import BESIDE, Float32s, image_law
from catoptra_server.scene.motion import Twist

Whole = npt.NDArray[np.intp]
Scene = tuple[npt.NDArray[Real], npt.NDArray[Real]]


class ImageMotion(Generic[Real]):
    """The flows of a frame, in float32 or float64.

    Pixels are told by their (n,) numbers, row by row; what has two components, u and v, is (2, n).
    nearness: (h w,) 1 / range, 1/m. mover: (h w,). stands: (h w,), BESIDE to INNER.
    """

    def __init__(self, camera: OmniCamera, capture: Capture, dtype: np.dtype[Real]) -> None:
        assert capture.geometry is not None, "motion needs what each pixel sees"
        self.width, self.height = camera.width_px, camera.height_px
        self._row, self._column = (at.reshape(-1) for at in np.indices((self.height, self.width)))
        self._dtype: np.dtype[Real] = dtype
        law = image_law(camera)
        self._to = law.to_u.reshape(-1, 3), law.to_v.reshape(-1, 3)
        self._about = law.about_u.reshape(-1, 3), law.about_v.reshape(-1, 3)
        self.stands = law.standing.reshape(-1)
        self._motion = capture.motion
        self.mover = capture.geometry.mover.reshape(-1)
        self.nearness: npt.NDArray[Real] = dtype.type(1.0) / capture.geometry.range_m.reshape(
            -1
        ).astype(dtype)
        scene = capture.motion[SCENE]
        self._slide: npt.NDArray[Real] = self._products(self._to, scene.linear_m_s)
        self._spin: npt.NDArray[Real] = self._products(self._about, scene.angular_rad_s)

    def of_scene(self, pixels: Whole) -> Scene[Real]:
        """Return slide and spin of the scene at pixels, (2, n) each."""
        return self._slide[:, pixels], self._spin[:, pixels]

    def flow(
        self, pixels: Whole, shown: Whole, of_scene: Scene[Real] | None = None
    ) -> npt.NDArray[Real]:
        """Return the (2, n) px/s at pixels of what other pixels show, were it there.

        of_scene: that of these pixels, for who asks for them again and again.
        """
        slide, spin = of_scene or self.of_scene(pixels)
        flow: npt.NDArray[Real] = slide * self.nearness[shown]
        flow += spin
        for twist, at in self._bodies(shown):
            slide = self._products(self._to, twist.linear_m_s, pixels[at])
            spin = self._products(self._about, twist.angular_rad_s, pixels[at])
            flow[:, at] = slide * self.nearness[shown[at]] + spin
        return flow

    def spin(self, pixels: Whole, shown: Whole) -> npt.NDArray[Real]:
        """Return the (2, n) part of the flow that turns make."""
        spin: npt.NDArray[Real] = self._spin[:, pixels]
        for twist, at in self._bodies(shown):
            spin[:, at] = self._products(self._about, twist.angular_rad_s, pixels[at])
        return spin

    def _bodies(self, shown: Whole) -> list[tuple[Twist, Whole]]:
        """Return each body's twist, and where it is what is shown."""
        if len(self._motion) == 1:
            return []
        mover = self.mover[shown]
        found = ((twist, np.flatnonzero(mover == n)) for n, twist in enumerate(self._motion))
        return [(twist, at) for twist, at in list(found)[1:] if at.size]

    def _products(
        self,
        rows: tuple[Float32s, Float32s],
        vector: tuple[float, float, float],
        pixels: Whole | slice = slice(None),
    ) -> npt.NDArray[Real]:
        values = np.asarray(vector, dtype=self._dtype)
        return np.stack([row[pixels].astype(self._dtype, copy=False) @ values for row in rows])

    def shown_at(self, pixels: Whole, aside: npt.NDArray[Real]) -> Whole:
        """Return the pixels (2, n) px aside of others; these themselves where no mirror is."""
        places, standing = self.standing(pixels, aside)
        return np.where(standing > BESIDE, places, pixels)

    def standing(self, pixels: Whole, aside: npt.NDArray[Real]) -> tuple[Whole, Float32s]:
        """Return the (n,) pixels so far aside of others, and how they stand to the mirror.

        What lies beside the picture stands beside the mirror, with a number of no meaning.
        """
        row, column = self._row[pixels], self._column[pixels]
        step = np.floor(aside + self._dtype.type(0.5)).astype(np.intp)
        column, row = column + step[0], row + step[1]
        inside = (column >= 0) & (column < self.width) & (row >= 0) & (row < self.height)
        places = np.where(inside, row * self.width + column, 0)
        return places, np.where(inside, self.stands[places], np.float32(BESIDE))

    @property
    def has_bodies(self) -> bool:
        """Return whether anything moves of its own."""
        return len(self._motion) > 1


def motion_uniforms(camera: OmniCamera, capture: Capture, duration_s: float) -> Uniforms:
    """Return what `image_motion.glsl` is told: the camera's maps, and the movers' twists."""
    law = image_law(camera)
    twists = [(twist.linear_m_s, twist.angular_rad_s) for twist in capture.motion]
    return {
        "to_u": law.to_u,
        "to_v": law.to_v,
        "about_u": law.about_u,
        "about_v": law.about_v,
        "standing": law.standing,
        "twists": np.array(twists, dtype=np.float32),
        "duration_s": np.array([duration_s], dtype=np.float32),
    }
