"""Choice of a plan by explicit numbers: that of the chosen renderer, if it can show the image."""

from __future__ import annotations

import logging
from collections.abc import Collection

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.camera_rays import CENTRAL_ERROR_PX, max_miss_m, near_limit_m
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.planning.error_bound import ErrorBound, error_bound
from catoptra_server.planning.explicit_plan import needs_exact_rays, plan_from_settings
from catoptra_server.planning.plan_choice import PlanChoice
from catoptra_server.render.renderer import RenderPlan
from catoptra_server.render.renderer_kind import RendererKind

log = logging.getLogger(__name__)

# Displacement over the image's radius: an image that is off by a twentieth shows other things. In a
# tiny image half a texel is as much, and all is well.
_MAX_FACES_FRACTION = 0.05
_FINE_FACES_PX = 1.2


def choose_by_settings(
    camera: OmniCameraSpec, kind: RendererKind, reason: str, *, usable: Collection[RendererKind]
) -> PlanChoice:
    """Plan of a camera without an accuracy target, with its bound where the error has one.

    Args:
        kind: The chosen renderer.
        reason: Reason of that choice.
        usable: Renderers that may draw the camera if that one cannot.

    Raises:
        DomainError: The renderer cannot show the image, and no other may replace it.
    """
    choice = _bound_plan(camera, kind, reason)
    what = _find_fault(camera, kind, choice.bound)
    if not what:
        return choice
    without_faces = [one for one in RendererKind if not one.uses_faces]
    other = next((one for one in without_faces if one in usable), None)
    if other is None or camera.render_settings.renderer:
        names = " or ".join(one.value for one in without_faces)
        raise DomainError(f"{what}: choose the renderer {names}, {_other_remedy(camera)}")
    return _bound_plan(camera, other, what)


def _find_fault(camera: OmniCameraSpec, kind: RendererKind, bound: ErrorBound | None) -> str:
    """Why a renderer cannot show a camera's image; empty if it can."""
    if needs_exact_rays(camera.camera, kind):
        miss_mm = 1e3 * max_miss_m(camera.camera)
        error_px = camera.render_settings.central_error_px or CENTRAL_ERROR_PX
        return (
            f"rays of this mirror miss one viewpoint by up to {miss_mm:.2g} mm, and faces of "
            f"{kind.value} have one: what is nearer than "
            f"{near_limit_m(camera.camera, error_px):.3g} m would be displaced by more than "
            f"{error_px:g} px"
        )
    faces_px = _unusable_faces_px(camera, bound)
    if not faces_px:
        return ""
    return (
        f"the faces of {kind.value} would displace this camera's image by {faces_px:.0f} of "
        f"{camera.camera.width_px} px"
    )


def _other_remedy(camera: OmniCameraSpec) -> str:
    if not camera.camera.has_mirror:
        return "or a smaller FieldOfView"
    if camera.camera.is_central:
        return "or a mirror with K farther from 2"
    return "or state Central=always for the mirror"


def _bound_plan(camera: OmniCameraSpec, kind: RendererKind, reason: str) -> PlanChoice:
    plan = plan_from_settings(camera.render_settings, camera.camera, kind=kind, reason=reason)
    return PlanChoice(plan, _find_error_bound(camera.camera, plan))


def _unusable_faces_px(camera: OmniCameraSpec, bound: ErrorBound | None) -> float:
    """Displacement by faces that cannot be made fine enough to show the image; 0 for others.

    The largest faces have too few texels for a mirror next to k = 2, whose image is all of a tiny
    part of the sphere. Faces of a configured size are as coarse as their owner wants them.
    """
    if bound is None or camera.render_settings.face_size_px:
        return 0.0
    faces_px = bound.as_dict().get("faces_px", 0.0)
    allowed_px = max(_FINE_FACES_PX, _MAX_FACES_FRACTION * bound.rim_radius_px)
    return faces_px if faces_px > allowed_px else 0.0


def _find_error_bound(camera: OmniCamera, plan: RenderPlan) -> ErrorBound | None:
    try:
        return error_bound(camera, plan)
    except DomainError as error:
        log.info("this plan has no error bound: %s", error)
        return None
