"""Plan from explicit numbers: those of the robot's file, defaults for the rest.

The numbers are followed as they are; nothing is weighed. With an accuracy target `plan_choice`
picks one of many such plans.
"""

from __future__ import annotations

import math

from catoptra_protocol.optics.cube_map import visible_faces
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.planning.face_regions import face_regions, max_face_size_px
from catoptra_server.render.render_settings import MirrorSurface, RenderSettings
from catoptra_server.render.renderer import RenderPlan
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.mirror_mesh import Tessellation

# 2 x 2 removes most of the aliasing and still leaves a frame of 640 px within a tenth of a second
# on two cores.
DEFAULT_SAMPLES = 2
# More samples take three times as long on software OpenGL and remove a sixth of the error:
# measured in tests/measurements/raster_faces.py.
DEFAULT_FACE_SAMPLES = 1
# Finer faces cost in proportion and gain little, measured likewise.
DEFAULT_TEXELS_PER_PX = 1.0


def requested_samples(settings: RenderSettings) -> int:
    """Samples along a pixel's side: the configured number, or the default for 0."""
    return settings.samples or DEFAULT_SAMPLES


def plan_from_settings(
    settings: RenderSettings, camera: OmniCamera, *, kind: RendererKind, reason: str
) -> RenderPlan:
    """Plan a camera's frames by explicit numbers.

    Args:
        settings: Configured numbers; 0 takes the default. The accuracy target is not read.
        reason: Reason for the choice of the renderer; the plan's reason.
    """
    limit_rad = max_incidence_rad(camera, settings.surface)
    regions = face_regions(
        camera,
        limit_rad,
        size_px=settings.face_size_px,
        texels_per_px=settings.texels_per_px or DEFAULT_TEXELS_PER_PX,
    )
    return RenderPlan(
        renderer=kind,
        surface=settings.surface,
        samples=requested_samples(settings),
        face_size_px=max_face_size_px(regions),
        face_samples=settings.face_samples or DEFAULT_FACE_SAMPLES,
        faces=visible_faces(limit_rad),
        face_regions=regions,
        reason=reason,
    )


def max_incidence_rad(camera: OmniCamera, surface: MirrorSurface) -> float:
    """Largest incidence angle that a frame looks up, radians.

    Above the horizon a polygon looks higher than its corners. Corners up to the rim's elevation e
    and 2 pi / S apart in azimuth span directions up to atan(tan e / cos(pi / S)).
    """
    elevation = camera.rim_rad - 0.5 * math.pi
    # Below the horizon the chord between two corners sags towards the axis: the rim is the limit.
    if not isinstance(surface, Tessellation) or elevation <= 0.0:
        return camera.rim_rad
    highest = math.atan(math.tan(elevation) / math.cos(math.pi / surface.sectors))
    return 0.5 * math.pi + highest


def needs_exact_rays(camera: OmniCamera, kind: RendererKind) -> bool:
    """Whether a renderer's faces have a viewpoint that the camera's rays miss."""
    return kind.uses_faces and not camera.is_central
