"""Mean luminance of an image on the device, for effects that depend on the whole image."""

from __future__ import annotations

import moderngl
import numpy as np

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_server.effects.kernels.luminance import LUMINANCE_WEIGHTS, count_valid_pixels
from catoptra_server.render.raster.linear_image_target import LinearImageTarget
from catoptra_server.render.raster.shader_programs import ProgramSpec, ShaderPrograms

# Rectangles a side that the device sums: few enough to read back, enough to occupy all its cores.
_METER_GRID_SIDE = 16


class LuminanceMeter:
    """Mean luminance of an image on the device; resources are built at the first measurement."""

    def __init__(
        self, context: moderngl.Context, programs: ShaderPrograms, image: moderngl.Texture
    ) -> None:
        self._context = context
        self._programs = programs
        self._image = image
        self._sums: LinearImageTarget | None = None

    def measure_mean_luminance(self, camera: RadialCamera) -> float:
        """Mean luminance of the pixels that show anything."""
        if self._sums is None:
            self._sums = LinearImageTarget(self._context, _METER_GRID_SIDE, _METER_GRID_SIDE)
            program = self._programs.get(
                ProgramSpec(
                    "fullscreen_triangle", "mean_luminance", (("GRID_SIDE", _METER_GRID_SIDE),)
                )
            )
            self._fullscreen_triangle = self._context.vertex_array(program, [])
        self._context.enable_only(moderngl.NOTHING)
        self._sums.target.use()
        self._image.use(0)
        self._fullscreen_triangle.render(vertices=3)
        # The device sums small rectangles in float32, the sums are added here in float64: a
        # float32 sum over the whole image would lose digits. Pixels off a mirror are black, so
        # the total is that of the others.
        colours = self._sums.read().sum(axis=(0, 1), dtype=np.float64)
        return float(colours @ LUMINANCE_WEIGHTS) / max(count_valid_pixels(camera), 1)

    def close(self) -> None:
        """Free the resources of a measurement, if any."""
        if self._sums is not None:
            self._fullscreen_triangle.release()
            self._sums.close()
