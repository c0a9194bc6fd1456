"""The mirror's picture by its own law, in every sample of every pixel."""

from __future__ import annotations

import math

import moderngl
import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.mirrors import CentralMirror, HyperbolicMirror, ParabolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.render.raster.atlas import Atlas
from catoptra_server.render.raster.atlas_lookup import atlas_definitions, use_atlas
from catoptra_server.render.raster.faces import FacePass
from catoptra_server.render.raster.programs import Programs, ProgramSpec, set_uniform
from catoptra_server.render.renderer import Exposure

# Sides of the polygon around the rim circle: it covers 1.3 % more than the disc, a square 27 %;
# more sides cost more in half-empty blocks of fragments than they save on llvmpipe.
_RIM_SIDES = 16


def law_of(mirror: CentralMirror) -> tuple[str, dict[str, float]]:
    """Return the GLSL file of a mirror's law and its uniforms. A new central mirror adds a case."""
    match mirror:
        case HyperbolicMirror():
            return "include/hyperbolic.glsl", {
                "mirror_kappa_s": mirror.kappa * mirror.s,
                "mirror_inverse_s2": 1.0 / mirror.s**2,
            }
        case ParabolicMirror():
            return "include/parabolic.glsl", {}
    raise DomainError(f"raster has no shader for the law of a {type(mirror).__name__}")


def camera_uniforms(camera: OmniCamera) -> dict[str, npt.ArrayLike]:
    """Return the uniforms of include/omni_camera.glsl, its mirror's law included, by name."""
    return {
        "camera_centre_px": camera.centre_px,
        "camera_inverse_h": 1.0 / camera.horizon_radius_px,
        "camera_rim_t": camera.rim_t,
        "camera_up": (math.cos(camera.up_azimuth_rad), math.sin(camera.up_azimuth_rad)),
        **law_of(camera.mirror)[1],
    }


def polygon_around_rim(camera: OmniCamera) -> Floats:
    """Return the (n, 2) clip positions of a polygon that holds every pixel that sees the mirror."""
    azimuth = 2.0 * math.pi * np.arange(_RIM_SIDES) / _RIM_SIDES
    # A pixel whose middle lies beyond the rim may have samples within it.
    radius = (camera.rim_radius_px + 1.0) / math.cos(math.pi / _RIM_SIDES)
    circle = radius * np.stack((np.cos(azimuth), np.sin(azimuth)), axis=-1)
    size = np.array((camera.width_px, camera.height_px))
    clip: Floats = 2.0 * (circle + camera.centre_px) / size - 1.0
    return clip


class PerPixelMirror:
    """The pass: one draw of the polygon around the rim, over black."""

    name = "mirror"

    def __init__(
        self,
        context: moderngl.Context,
        programs: Programs,
        faces: FacePass[Atlas],
        camera: OmniCamera,
        samples: int,
        target: moderngl.Framebuffer,
    ) -> None:
        self._context = context
        self._faces = faces
        self._target = target
        self._uniforms = camera_uniforms(camera)
        define = (("SAMPLES", samples), *atlas_definitions(faces.atlas))
        slots = (("mirror_law", law_of(camera.mirror)[0]),)
        self._program = programs.get(
            ProgramSpec("mirror_per_pixel", "mirror_per_pixel", define, slots)
        )
        self._corners = context.buffer(polygon_around_rim(camera).astype(np.float32).tobytes())
        self._vertices = context.vertex_array(self._program, [(self._corners, "2f", "position")])

    def draw(self, exposure: Exposure) -> None:
        """Fill the target. Views share the program, so its uniforms are set for every picture."""
        for name, value in self._uniforms.items():
            set_uniform(self._program, name, value)
        use_atlas(self._program, self._faces.atlas, self._faces.texture)
        self._context.enable_only(moderngl.NOTHING)
        self._target.use()
        self._target.clear()
        self._vertices.render(moderngl.TRIANGLE_FAN)

    def close(self) -> None:
        """Free the polygon."""
        self._vertices.release()
        self._corners.release()
