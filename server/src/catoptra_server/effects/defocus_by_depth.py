"""Defocus with each pixel's own depth: for things so near that their disc differs from infinity's.

Every pixel gathers the light of a uniform disc of |fixed + near / (power range + offset)| px,
`lens_blur`'s law with the range of what its middle sees. It does all that `Defocus` does, and so
takes its place: what a disc of another width blurred before cannot be made sharp again. Robot files
that name both leave the choice to the two criteria. Domain: that of `Defocus`. Criterion: how far
the disc of the nearest thing in view differs from that of infinity, in px.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.effects.capture import Capture
from catoptra_server.effects.defocus import APERTURE_PARAMETERS, Defocus
from catoptra_server.effects.effect import PIXELS, Bound, Kind, Real, Uniforms, floats
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.effects.shared.disc_kernel import DiscTable, disc_table, row_of
from catoptra_server.effects.shared.lens_blur import (
    Aperture,
    BlurLaw,
    blur_law,
    nearest_at,
    pixel_law,
    radii_px,
    telling,
    touching_px,
    whole_pixels,
    whole_radius_px,
)
from catoptra_server.effects.shared.symmetric_kernels import gathered_within


@dataclass(frozen=True, slots=True)
class DefocusByDepth:
    """The lens and what it is focused at."""

    aperture: Aperture

    name: ClassVar[str] = "DefocusByDepth"
    unit: ClassVar[str] = PIXELS
    uses_range: ClassVar[bool] = True

    def bound(self, summary: SceneSummary, camera: OmniCamera) -> Bound:
        """Return by how much the disc of what is nearest differs from that of infinity."""
        radius = radii_px(camera)
        law = blur_law(self.aperture, camera, radius)
        value = float(largest_change_px(law, nearest_at(summary, camera, radius)).max())
        nearest = min(summary.in_view_m)
        lens = telling(self.aperture, camera)
        where = f"{nearest:.2g} m away" if math.isfinite(nearest) else "far away"
        return Bound(value, f"{lens}: the nearest is {where}")

    def after(self, summary: SceneSummary) -> SceneSummary:
        """Return a summary in which the fixed part is done."""
        return replace(summary, done=summary.done | {Defocus.name})

    def apply(
        self, light: npt.NDArray[Real], camera: OmniCamera, capture: Capture
    ) -> npt.NDArray[Real]:
        """Return the blurred picture."""
        assert capture.range_m is not None, "depths were not asked for"
        law = pixel_law(self.aperture, camera)
        range_m = capture.range_m.astype(np.float64)
        row = row_of(law.diameter_px(range_m)).astype(light.dtype)
        table = _table(self, camera)
        reach = table.reach_up_to(float(row.max()))
        whole = whole_pixels(camera)
        return gathered_within(light, whole, reach, lambda rows: table.mixed(row[rows], reach))

    def uniforms(
        self, camera: OmniCamera, capture: Capture, mean_light: Callable[[], float]
    ) -> Uniforms:
        """Return each pixel's law, and the kernels' table."""
        return {
            "law": _law_map(self, camera),
            "weights": _table(self, camera).texture(),
            "centre_px": floats(*camera.centre_px),
            "whole_px": floats(whole_radius_px(camera)),
        }


def largest_change_px(law: BlurLaw, nearest_m: Floats) -> Floats:
    """Return the largest change of a disc between infinity and the nearest distance.

    What is behind the focus first shrinks, at most to a point, and then grows.
    """
    added = law.added_px(nearest_m)
    behind = np.maximum(-law.fixed_px, 0.0)
    shrunk = np.minimum(added, behind)
    grown = law.diameter_px(nearest_m) - np.abs(law.fixed_px)
    change: Floats = np.maximum(shrunk, grown)
    return change


def _table(effect: DefocusByDepth, camera: OmniCamera) -> DiscTable:
    """Return the kernels of all things outside the mirror, however near."""
    return disc_table(touching_px(effect.aperture, camera))


@lru_cache(maxsize=4)
def _law_map(effect: DefocusByDepth, camera: OmniCamera) -> npt.NDArray[np.float32]:
    """Return the (h, w, 4) law: fixed_px, near_px, power_per_m, offset."""
    law = pixel_law(effect.aperture, camera)
    parts = (law.fixed_px, law.near_px, law.power_per_m, law.offset)
    stacked: npt.NDArray[np.float32] = np.stack(parts, axis=-1).astype(np.float32)
    return stacked


def _made(f_number: float, pixel_pitch_m: float, focus_m: float) -> DefocusByDepth:
    return DefocusByDepth(Aperture(f_number, pixel_pitch_m, focus_m))


KIND = Kind("DefocusByDepth", _made, APERTURE_PARAMETERS)
