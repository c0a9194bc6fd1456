"""The plan of a frame: which renderer draws the mirror how, with how many samples, and why.

`plan_from_settings` makes a plan from explicit numbers. Where a tolerance or a time budget is asked for
(`robot.render_wish.Dial`), `planner` takes one of the plans that are possible; nothing that draws
notices.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube_map import Face, visible_faces
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.planning.face_regions import FaceRegion, face_regions, max_face_size_px
from catoptra_server.robot.render_settings import MirrorSurface, PerPixel, RenderSettings
from catoptra_server.scene.mirror_mesh import Tessellation

__all__ = [
    "PerPixel",
    "RenderPlan",
    "RenderSettings",
    "RendererKind",
    "MirrorSurface",
    "max_incidence_rad",
    "plan_from_settings",
    "requested_samples",
]


class RendererKind(Enum):
    """The two renderers."""

    TRACE = "trace"
    RASTER = "raster"


@dataclass(frozen=True, slots=True)
class RenderPlan:
    """How one camera is drawn.

    samples: the image has samples^2 per pixel. face_size_px (of the finest part), face_samples,
    faces, face_regions: of the virtual cameras, raster only. reason: why this plan, in words, for the
    log. stride_px: trace sends rays this far apart first, and those between only where something
    begins or ends there; nothing is lost by it (render/trace/silhouette_edges.py). 1: every ray at once.
    """

    renderer: RendererKind
    surface: MirrorSurface
    samples: int
    face_size_px: int
    face_samples: int
    faces: tuple[Face, ...]
    face_regions: tuple[FaceRegion, ...]
    reason: str
    stride_px: int = 1

    def __post_init__(self) -> None:
        if not 1 <= self.samples <= 16:
            raise DomainError(f"samples must be 1 to 16 along a pixel's side, not {self.samples}")
        if not 1 <= self.stride_px <= 64:
            raise DomainError(f"rays must be 1 to 64 px apart, not {self.stride_px}")
        if self.stride_px > 1 and not isinstance(self.surface, PerPixel):
            raise DomainError("a polygon mirror needs every ray: stride_px must be 1")

    def __str__(self) -> str:
        return f"{self.description}: {self.reason}"

    @property
    def description(self) -> str:
        """Return all but the reason in words."""
        match self.surface:
            case PerPixel():
                surface = "per pixel"
            case Tessellation(sectors, rings, interpolation):
                surface = f"{sectors} x {rings} polygons ({interpolation.value})"
        how = ""
        if self.renderer is RendererKind.RASTER:
            names = "".join(face.name for face in self.faces)
            how = f", faces {names} of {self.face_size_px} px"
            how += f" with {self.face_samples} samples each" if self.face_samples > 1 else ""
        elif self.stride_px > 1:
            how = f", rays {self.stride_px} px apart and wherever an outline passes"
        return f"{self.renderer.value}, {surface}, {self.samples}^2 samples{how}"


# Samples along a pixel's side where nothing is asked: 2 x 2 removes most of the jaggies and still
# leaves a 640 px frame within a tenth of a second on two cores.
DEFAULT_SAMPLES = 2
# More cost three times the frame on software OpenGL and gain a sixth of the error: measured in
# tests/measurements/raster_faces.py.
DEFAULT_FACE_SAMPLES = 1
# Of 2, 4, 6 and 8 px within a tenth of the fastest at one sample a pixel and at 2 x 2, in nearly
# every scene of tests/measurements/sparse_rays.py.
DEFAULT_STRIDE_PX = 4
# One texel a pixel: finer faces cost in proportion and gain little, measured likewise.
DEFAULT_TEXELS_PER_PX = 1.0


def requested_samples(settings: RenderSettings) -> int:
    """Return the samples along a pixel's side: what was asked for, else the default."""
    return settings.samples or DEFAULT_SAMPLES


def plan_from_settings(
    settings: RenderSettings, camera: OmniCamera, *, kind: RendererKind, reason: str
) -> RenderPlan:
    """Return the plan from explicit numbers; `why` says how the renderer was chosen."""
    limit_rad = max_incidence_rad(camera, settings.surface)
    parts = face_regions(
        camera,
        limit_rad,
        size_px=settings.face_size_px,
        texels_per_px=settings.texels_per_px or DEFAULT_TEXELS_PER_PX,
    )
    return RenderPlan(
        renderer=kind,
        surface=settings.surface,
        samples=requested_samples(settings),
        face_size_px=max_face_size_px(parts),
        face_samples=settings.face_samples or DEFAULT_FACE_SAMPLES,
        faces=visible_faces(limit_rad),
        face_regions=parts,
        reason=reason,
        stride_px=_stride_px(settings),
    )


def _stride_px(settings: RenderSettings) -> int:
    """Return how far apart trace's first rays are; a polygon mirror's law is not smooth enough."""
    if not isinstance(settings.surface, PerPixel):
        return 1
    return settings.stride_px or DEFAULT_STRIDE_PX


def max_incidence_rad(camera: OmniCamera, surface: MirrorSurface) -> float:
    """Return the largest incidence angle that is looked up, radians.

    Above the horizon a polygon looks higher than its corners. Corners up to the rim's elevation e
    and 2 pi / S apart in azimuth span directions up to atan(tan e / cos(pi / S)).
    """
    elevation = camera.rim_rad - 0.5 * math.pi
    if not isinstance(surface, Tessellation) or elevation <= 0.0:
        return camera.rim_rad
    highest = math.atan(math.tan(elevation) / math.cos(math.pi / surface.sectors))
    return 0.5 * math.pi + highest
