"""Size of a view in memory, from the numbers of its plan alone."""

from __future__ import annotations

import math

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_server.planning.explicit_plan import DEFAULT_SAMPLES, plan_from_settings
from catoptra_server.render.render_settings import RenderSettings
from catoptra_server.render.renderer import RenderPlan
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.runtime.memory import ViewSize


def plan_view_size(camera: OmniCamera, plan: RenderPlan, *, has_effects: bool = False) -> ViewSize:
    """Size of the view of a plan; faces count where the plan's renderer has them."""
    num_texels = math.ceil(sum(region.num_texels for region in plan.face_regions))
    return ViewSize(
        num_pixels=camera.width_px * camera.height_px,
        samples_per_pixel=plan.samples**2,
        num_texels=num_texels if plan.renderer.uses_faces else 0,
        samples_per_texel=plan.face_samples,
        has_effects=has_effects,
        has_origins=not camera.is_central,
    )


def omni_view_size(camera: OmniCamera, settings: RenderSettings, *, has_effects: bool) -> ViewSize:
    """Size of the view that explicit settings describe, whichever renderer is chosen."""
    # With faces a view holds more than rays.
    kind = next(kind for kind in RendererKind if kind.uses_faces)
    plan = plan_from_settings(settings, camera, kind=kind, reason="size")
    return plan_view_size(camera, plan, has_effects=has_effects)


def perspective_view_size(camera: PerspectiveCamera, *, has_effects: bool = False) -> ViewSize:
    """Size of the view of a perspective camera."""
    # In raster the samples are the texels of a single face, which has no lookup map: 14 bytes a
    # sample, fewer than trace's rays.
    num_pixels = camera.width_px * camera.height_px
    return ViewSize(num_pixels, DEFAULT_SAMPLES**2, has_effects=has_effects)
