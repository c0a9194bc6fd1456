"""Misalignment: the capture camera's pinhole is displaced from the mirror's second focus.

L'(p) = L(q(p)): q is the aligned camera's pixel with the direction of p's reflected ray
(`kernels/warp`); bilinear between pixels, in linear radiance. Black where the ray misses the
mirror, or comes from beyond the aligned camera's rim; at the mirror's edge by the fraction of the
pixel that it covers, so that the rim is as smooth as without. Not simulated: parallax, since the
reflected rays no longer meet in one point. In the paper's mirror they pass the viewpoint at up to
0.19 of the pinhole's offset: 1 mm displaces a point 1 m away by at most 0.04 px of 360, and farther
ones less. Domain: central mirrors. Criterion: the largest of |q - p| times the contrast of black
and the brightest, with the light that the edge takes.

In the paper's image of 360 px, 1 mm sideways displaces everything by 3.4 to 4.7 px. With the camera
aimed anew, so that the rim is at its old position, directions are still up to 0.8 px off.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.elementary import dot, hypot
from catoptra_protocol.optics.numerics import Bools
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import (
    AVERAGING,
    NEEDS_MIRROR,
    CaptureContext,
    EffectBound,
    EffectParameter,
    EffectType,
    Gains,
    Real,
    SceneSummary,
)
from catoptra_server.effects.kernels.grey_levels import (
    exchange_by_shift,
    max_change_by_exchange,
)
from catoptra_server.effects.kernels.warp import (
    CameraPoseOffset,
    WarpMap,
    lookup_offsets_px,
    warp,
    warp_map_from_offsets,
)


@dataclass(frozen=True, slots=True)
class Misalignment:
    """Displacement and tilt of the capture camera, in the mirror frame."""

    x_m: float = 0.0
    """Offset of the pinhole along x."""
    y_m: float = 0.0
    """Offset of the pinhole along y."""
    axial_m: float = 0.0
    """Offset of the pinhole away from the mirror."""
    roll_rad: float = 0.0
    """Turn about x."""
    pitch_rad: float = 0.0
    """Turn about y."""

    name: ClassVar[str] = "Misalignment"
    changes_scene: ClassVar[bool] = False
    gains: ClassVar[Gains] = AVERAGING
    reads: ClassVar[frozenset[str]] = frozenset({"max_radiance"})
    needs_range: ClassVar[bool] = False

    @property
    def camera_pose_offset(self) -> CameraPoseOffset:
        """Pose of the camera relative to the aligned one."""
        translation_m = (self.x_m, self.y_m, self.axial_m)
        return CameraPoseOffset(translation_m, self.roll_rad, self.pitch_rad)

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Bound the change by the largest displacement, and by pixels that turn black."""
        assert isinstance(camera, OmniCamera), NEEDS_MIRROR
        # Decided without the map, which takes a reflected ray for every pixel.
        if self.camera_pose_offset == CameraPoseOffset():
            return EffectBound(0.0, "the camera is aligned")
        lookup, kept = lookup_maps(self, camera)
        offsets_px = lookup[..., :2]
        # The map itself is bounded, not the optics: its rounding to float32 is below a part in 1e7.
        displacement_px = hypot(camera.width_px, camera.height_px)
        if kept.any():
            # Pixels that see nothing have 0.
            displacement_px = float(np.sqrt(dot(offsets_px, offsets_px)).max())
        lost = float((1.0 - kept[_lit_pixels(camera)]).max(initial=0.0))
        offset_mm = 1e3 * hypot(*self.camera_pose_offset.translation_m)
        tilt = math.degrees(hypot(self.roll_rad, self.pitch_rad))
        reason = f"the pinhole is {offset_mm:.3g} mm off the mirror's focus"
        exchanged = exchange_by_shift(displacement_px)
        return EffectBound(
            max_change_by_exchange(lost + (1.0 - lost) * exchanged, summary.picture_radiance),
            f"{reason}, tilted by {tilt:.3g} degrees" if tilt else reason,
            displacement_px,
        )

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same summary: interpolation makes no pixel brighter."""
        return summary

    def apply(
        self, image: npt.NDArray[Real], camera: RadialCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Warp the image to the displaced camera."""
        assert isinstance(camera, OmniCamera), NEEDS_MIRROR
        return warp(image, _warp_map(self, camera)) * lookup_maps(self, camera)[1][..., None]


# Half a pixel's diagonal.
_HALF_DIAGONAL_PX = 0.7072


def _lit_pixels(camera: OmniCamera) -> Bools:
    """Pixels, (h, w), of which any part may show the mirror."""
    u = np.arange(0.5, camera.width_px) - camera.centre_px[0]
    v = np.arange(0.5, camera.height_px) - camera.centre_px[1]
    reach_px = camera.rim_radius_px * camera.max_stretch + _HALF_DIAGONAL_PX
    is_lit: Bools = hypot(u, v[:, None]) < reach_px
    return is_lit


@lru_cache(maxsize=8)
def lookup_maps(
    effect: Misalignment, camera: OmniCamera
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]:
    """Where pixels look, and how much of that light they get.

    Returns:
        (h, w, 3) offset in u and v to the pixel to read, px, and whether the centre sees, 1 or 0;
        (h, w) fraction of the light that is read which the mirror's edge leaves to the pixel.
    """
    # Offsets instead of positions: float32 keeps a displacement of a few pixels to 2e-7 px, but a
    # position at 640 px only to 3e-5 px.
    offsets, valid, kept = lookup_offsets_px(camera, effect.camera_pose_offset)
    lookup = np.zeros((*valid.shape, 3), dtype=np.float32)
    lookup[..., :2], lookup[..., 2] = offsets, valid
    edge = kept.astype(np.float32)
    for one in (lookup, edge):
        one.setflags(write=False)
    return lookup, edge


@lru_cache(maxsize=4)
def _warp_map(effect: Misalignment, camera: OmniCamera) -> WarpMap:
    # Made of the float32 map, so that the kernel's stage has the same weights.
    return warp_map_from_offsets(lookup_maps(effect, camera)[0][..., :2])


EFFECT_TYPE = EffectType(
    "Misalignment",
    Misalignment,
    (
        EffectParameter("MisalignmentX", "x_m", 0.0, -0.02, 0.02),
        EffectParameter("MisalignmentY", "y_m", 0.0, -0.02, 0.02),
        EffectParameter("MisalignmentAxial", "axial_m", 0.0, -0.05, 0.05),
        EffectParameter("MisalignmentRoll", "roll_rad", 0.0, -0.1, 0.1),
        EffectParameter("MisalignmentPitch", "pitch_rad", 0.0, -0.1, 0.1),
    ),
    needs_mirror=True,
    needs_viewpoint=True,
)
