"""Choice between the exact rays of a mirror without a viewpoint and rays from its best one.

Seen from afar both are one: rays miss the best viewpoint by millimetres, which is an angle at the
distance of what they show. `Central=auto` leaves the choice to each frame, by the nearest thing of
the scene; the near limit is the distance from which the image errs by at most the allowed pixels.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

from catoptra_protocol.optics.camera_rays import CENTRAL_ERROR_PX, max_miss_m, near_limit_m
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.planning.camera_spec import CameraSpec, OmniCameraSpec

_SELF_VIEW = "SelfView"


def leaves_choice(spec: CameraSpec) -> bool:
    """Whether each frame of a camera may be drawn exactly or from one viewpoint.

    Not with a tolerance, which the bound of the approximation, larger than its error, would use up.
    """
    return (
        isinstance(spec, OmniCameraSpec)
        and spec.render_settings.central_error_px > 0.0
        and not spec.render_settings.accuracy_target.max_error_px
        and not spec.camera.is_central
    )


def choose_viewpoint(spec: OmniCameraSpec, nearest_m: float) -> OmniCameraSpec:
    """Camera to draw: from one viewpoint where nothing is nearer than the near limit.

    Args:
        spec: A camera that leaves the choice.
        nearest_m: Distance of the nearest thing in view, or less.
    """
    if nearest_m < _find_near_limit_m(spec.camera, spec.render_settings.central_error_px):
        return spec
    return replace(spec, camera=replace(spec.camera, is_approximated=True))


def shows_ego_body(spec: OmniCameraSpec) -> bool:
    """Whether a camera's frames may show the own robot."""
    return any(setting.effect.name == _SELF_VIEW for setting in spec.effect_settings.settings)


def describe_viewpoint(spec: OmniCameraSpec) -> str:
    """How a plan treats rays without a viewpoint; empty for a mirror or a lens with one."""
    camera, settings = spec.camera, spec.render_settings
    if not camera.has_mirror or camera.mirror.is_central:
        return ""
    limit = f"{_find_near_limit_m(camera, settings.central_error_px or CENTRAL_ERROR_PX):.3g} m"
    if not settings.central_error_px or settings.accuracy_target.max_error_px:
        rays = "one viewpoint for all rays" if camera.is_approximated else "exact rays"
        return f"{rays}, central from {limit}"
    if camera.is_approximated:
        return f"one viewpoint for all rays: nothing is nearer than {limit}"
    return f"exact rays while anything is nearer than {limit}"


def explain_viewpoint(spec: OmniCameraSpec, nearest_m: float) -> str:
    """Miss, near limit and clearance of a mirror without a viewpoint; empty for others.

    Args:
        nearest_m: Lower bound of the distance of everything in view.
    """
    camera = spec.camera
    if not camera.has_mirror or camera.mirror.is_central:
        return ""
    error_px = spec.render_settings.central_error_px or CENTRAL_ERROR_PX
    return (
        f"no single viewpoint: rays miss the best one by up to {1e3 * max_miss_m(camera):.2g} mm; "
        f"central to {error_px:g} px from {_find_near_limit_m(camera, error_px):.3g} m; nothing "
        f"is nearer than {nearest_m:.3g} m here"
    )


@lru_cache(maxsize=256)
def _find_near_limit_m(camera: OmniCamera, error_px: float) -> float:
    """Near limit, which every frame compares with: 257 rings take a millisecond."""
    return near_limit_m(camera, error_px)
