"""Uniforms that all programs of the face pass share within a frame."""

from __future__ import annotations

import moderngl
import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.raster.shader_programs import set_uniform
from catoptra_server.render.raster.split_positions import split_positions
from catoptra_server.world.world_description import PointLight


@dataclass(frozen=True, slots=True, eq=False)
class FrameUniforms:
    """Viewpoint, depth mapping and point lights of one frame."""

    viewpoint: Floats
    """(3,) position in the scene's frame, metres."""
    depth_from_forward: tuple[float, float]
    """(a, b) of clip z = a w + b."""
    light_positions: Floats
    """(k, 3) positions of point lights relative to the viewpoint, metres."""
    light_intensities: Floats
    """(k, 3) irradiance at one metre."""

    @classmethod
    def from_viewpoint(
        cls,
        viewpoint: Floats,
        depth_from_forward: tuple[float, float],
        *,
        lights: tuple[PointLight, ...],
        origin: Floats,
    ) -> FrameUniforms:
        """Uniforms of a viewpoint; `origin` is the scene frame's, since lights are in the world."""
        # Differences in float64, before the cast: both positions may be far from the origin.
        offsets = [np.asarray(light.position_m) - origin - viewpoint for light in lights]
        intensities = [light.intensity for light in lights]
        return cls(
            viewpoint,
            depth_from_forward,
            np.asarray(offsets).reshape(-1, 3),
            np.asarray(intensities, dtype=np.float64).reshape(-1, 3),
        )

    def apply_to(self, program: moderngl.Program) -> None:
        """Write the uniforms to a program."""
        viewpoint = split_positions(self.viewpoint)
        set_uniform(program, "viewpoint", viewpoint[:3])
        set_uniform(program, "viewpoint_rest", viewpoint[3:])
        set_uniform(program, "depth_from_forward", self.depth_from_forward)
        # GLSL has no arrays of length zero: programs of a world without point lights lack these
        # uniforms.
        if len(self.light_positions):
            set_uniform(program, "light_positions", self.light_positions)
            set_uniform(program, "light_intensities", self.light_intensities)
