"""Misalignment: the capture camera's pinhole does not stand at the mirror's second focus.

L'(p) = L(q(p)): q is the pixel of the ideal camera that shows what p's ray, reflected, shows of
what is far away (`misaligned_rays`); between pixels bilinear, in linear light. Black where the ray
misses the mirror, or comes from beyond the ideal camera's rim. Not simulated: parallax, since the
reflected rays no longer meet in one point. In the paper's mirror they pass the viewpoint at up to
0.19 of the pinhole's offset: 1 mm misplaces what is 1 m away by at most 0.04 px of 360, and less
what is farther. Domain: central mirrors. Criterion: the largest of |q - p|.

In the paper's picture of 360 px, 1 mm sideways moves all by 3.4 to 4.7 px. Aimed anew, so that the
rim stands where it did, the camera still shows directions up to 0.8 px off.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.capture_context import CaptureContext
from catoptra_server.effects.effect import (
    PIXELS,
    EffectBound,
    EffectParameter,
    EffectType,
    Real,
    Uniforms,
)
from catoptra_server.effects.kernels.misaligned_rays import CameraPoseOffset, lookup_offsets_px
from catoptra_server.effects.kernels.warp import WarpMap, warp, warp_map_from_offsets
from catoptra_server.effects.scene_summary import SceneSummary


@dataclass(frozen=True, slots=True)
class Misalignment:
    """x_m, y_m: the pinhole's offset in the mirror frame; axial_m: away from the mirror.

    roll_rad, pitch_rad: turns of the camera about x and y.
    """

    x_m: float = 0.0
    y_m: float = 0.0
    axial_m: float = 0.0
    roll_rad: float = 0.0
    pitch_rad: float = 0.0

    name: ClassVar[str] = "Misalignment"
    unit: ClassVar[str] = PIXELS
    needs_range: ClassVar[bool] = False

    @property
    def camera_pose_offset(self) -> CameraPoseOffset:
        """Return where the camera stands."""
        offset = (self.x_m, self.y_m, self.axial_m)
        return CameraPoseOffset(offset, self.roll_rad, self.pitch_rad)

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> EffectBound:
        """Return how far off the most displaced pixel looks; of no use, by the whole picture."""
        if self.camera_pose_offset == CameraPoseOffset():
            return EffectBound(0.0, "the camera stands where it belongs")
        aside = lookup_offset_map(self, camera)
        seen = aside[..., 2] > 0.0
        whole = math.hypot(camera.width_px, camera.height_px)
        # float32 rounds the map by less than a part in 1e7.
        shift = float(np.hypot(aside[..., 0], aside[..., 1])[seen].max()) if seen.any() else whole
        offset_mm = 1e3 * math.hypot(*self.camera_pose_offset.translation_m)
        tilt = math.degrees(math.hypot(self.roll_rad, self.pitch_rad))
        reason = f"the pinhole is {offset_mm:.3g} mm off the mirror's focus"
        return EffectBound(shift, f"{reason}, tilted by {tilt:.3g} degrees" if tilt else reason)

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same: nothing becomes brighter."""
        return summary

    def apply(
        self, image: npt.NDArray[Real], camera: OmniCamera, context: CaptureContext
    ) -> npt.NDArray[Real]:
        """Return the picture as the displaced camera sees it."""
        read = warp(image, _warp(self, camera))
        read[lookup_offset_map(self, camera)[..., 2] == 0.0] = 0.0
        return read

    def uniforms(
        self,
        camera: OmniCamera,
        context: CaptureContext,
        measure_mean_luminance: Callable[[], float],
    ) -> Uniforms:
        """Return the map."""
        return {"read_instead": lookup_offset_map(self, camera)}


@lru_cache(maxsize=4)
def lookup_offset_map(effect: Misalignment, camera: OmniCamera) -> npt.NDArray[np.float32]:
    """Return (h, w, 3): how far aside of each pixel to read, in u and v, and 1 or 0 for black."""
    aside, seen = lookup_offsets_px(camera, effect.camera_pose_offset)
    told = np.concatenate((aside, seen[..., None]), axis=-1).astype(np.float32)
    told.setflags(write=False)
    return told


@lru_cache(maxsize=4)
def _warp(effect: Misalignment, camera: OmniCamera) -> WarpMap:
    return warp_map_from_offsets(lookup_offset_map(effect, camera)[..., :2])


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
)
