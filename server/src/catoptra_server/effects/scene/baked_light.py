"""Baked light: its differences between the points of a surface.

Not a change of the image but of the scene's light: each surface has a grid of nodes
(`render/trace/occlusion/light_bake.py`). Without the effect all points of a surface have the mean
light of its grid, and no ray looks anything up. Bodies that move take the part of it that their
box hides: its form factor, exact within 0.6 m of it, less up to 0.8 m and nothing beyond. Source:
Baum et al. 1989, "Improving Radiosity Solutions Through the Use of Analytically Determined
Form-Factors". Domain: worlds with `LightBake=on`; cameras that name no mode decide by the
criterion. Criterion: the largest change of a white surface between a node and the mean of its grid,
the stated error of the node included; with bodies, between light and none. In mode auto the native
kernel measures the change of each sample as if its surface reflected what shows it most. Raster
draws no shade of bodies.
"""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import (
    AVERAGING,
    SHADED_BY_BODIES,
    EffectBound,
    EffectType,
    Gains,
    SceneSummary,
)
from catoptra_server.effects.kernels.grey_levels import find_changes
from catoptra_server.world.objects import CameraState

# A surface darker than white changes by less, but for the jump of the sRGB curve's slope.
_JUMP = 1.0173


def find_grid_changes(ranges: Floats, gains: Gains) -> Floats:
    """(m,) largest changes, grey levels, between the nodes of grids and the means of these.

    Args:
        ranges: (3, m, 3) least, mean and largest irradiance of each.
        gains: Factors from the scene's light to that of the finished picture.
    """
    changes = find_changes(ranges[[0, 2]], ranges[[1, 1]], (0.0, gains[1]))
    largest: Floats = np.minimum(_JUMP * changes.max(axis=(0, 2), initial=0.0), 255.0)
    return largest


@dataclass(frozen=True, slots=True)
class BakedLight:
    """Baked light by the nodes of grids. No parameters: the world's file has the light."""

    name: ClassVar[str] = "BakedLight"
    changes_scene: ClassVar[bool] = True
    gains: ClassVar[Gains] = AVERAGING
    reads: ClassVar[frozenset[str]] = frozenset({"light_bake", "open_irradiance", "has_bodies"})

    def bound(self, summary: SceneSummary, camera: RadialCamera) -> EffectBound:
        """Change between a node and the mean of its grid."""
        light = summary.light_bake
        if light is None or light.ranges is None:
            return EffectBound(0.0, "the world has no baked light")
        ranges = light.ranges * np.array(summary.open_irradiance)
        ranges[0] *= not summary.has_bodies
        changes = find_grid_changes(ranges, summary.gains)
        bodies = SHADED_BY_BODIES if summary.has_bodies else ""
        differing = np.count_nonzero(~light.is_constant)
        reason = (
            f"{bodies}light differs on {differing} of {len(changes)} surfaces; "
            f"of 99 % of its nodes the stated error is below {light.stated_error:.3g} levels"
        )
        # In a mean of samples up to white those beyond weigh less than their light's inverse, and
        # all others 1 together: both add as powers of the curve, 2.4, or less than as squares.
        is_bright = summary.gains[1] * ranges.max(axis=(0, 2), initial=0.0) > 1.0
        squares = np.square(changes)
        total = squares.max(initial=0.0) + squares[is_bright].max(initial=0.0)
        return EffectBound(min(math.sqrt(total), 255.0), reason)

    def update_summary(self, summary: SceneSummary) -> SceneSummary:
        """Return the same summary: it counts with the brightest nodes."""
        return summary

    def apply_to_scene(self, camera_state: CameraState, displacement_px: float) -> CameraState:
        """Return the same state: `apply_scene_effects` takes from it what is left out."""
        return camera_state


EFFECT_TYPE = EffectType("BakedLight", BakedLight)
