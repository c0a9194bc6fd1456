"""What all programs of the face pass are told once a frame. Float64 twin: none, it only carries."""

from __future__ import annotations

from dataclasses import dataclass

import moderngl
import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.raster.shader_programs import set_uniform
from catoptra_server.scene.world_description import PointLight


@dataclass(frozen=True, slots=True, eq=False)
class FrameUniforms:
    """A (3,) viewpoint in the scene's frame, z = a w + b, and the point lights.

    light_positions: (k, 3) relative to the viewpoint. light_intensities: (k, 3).
    """

    viewpoint: Floats
    depth_from_forward: tuple[float, float]
    light_positions: Floats
    light_intensities: Floats

    @classmethod
    def from_viewpoint(
        cls,
        viewpoint: Floats,
        depth_from_forward: tuple[float, float],
        *,
        lights: tuple[PointLight, ...],
        origin: Floats,
    ) -> FrameUniforms:
        """Return the uniforms; `origin` is of the scene's frame, in which the lights are not."""
        towards = [np.asarray(light.position_m) - origin - viewpoint for light in lights]
        intensity = [light.intensity for light in lights]
        return cls(
            viewpoint,
            depth_from_forward,
            np.asarray(towards).reshape(-1, 3),
            np.asarray(intensity, dtype=np.float64).reshape(-1, 3),
        )

    def apply_to(self, program: moderngl.Program) -> None:
        """Set them; a program of the face pass has lights exactly where the world has."""
        set_uniform(program, "viewpoint", self.viewpoint)
        set_uniform(program, "depth_from_forward", self.depth_from_forward)
        if len(self.light_positions):
            set_uniform(program, "light_positions", self.light_positions)
            set_uniform(program, "light_intensities", self.light_intensities)
