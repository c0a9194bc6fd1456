"""The single effective viewpoint in an upright section, to scale: the paper's Figure 2.

Rays that aim at the viewpoint are reflected into the pinhole. So the frame can be resampled to the
images that a camera at the viewpoint would take: on a cylinder around that point, or on a plane.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_client.unwarp import CylinderGeometry, PerspectiveGeometry, make_unwarp_map, unwarp
from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_studies.camera_figures.figure_spec import FIGURE_SAMPLES, FigureCaption, FigureInputs
from catoptra_studies.plot_style import (
    BLUE,
    FOREGROUND,
    MUTED,
    ORANGE,
    TEAL,
    Axes,
    Page,
    add_axes,
    add_text,
    show_image,
)
from catoptra_studies.study_subject import StudySubject

# Incidence angles of the rays: left through the plane, right through the cylinder.
_PLANE_THETA_DEG = (50.0, 62.0, 74.0)
_CYLINDER_THETA_DEG = (55.0, 75.0, 95.0, 110.0)
# Distances of both surfaces from the viewpoint in units of the mirror's radius; any would do, since
# only directions count.
_CYLINDER_RADII, _PLANE_RADII = 2.3, 2.4
_FRAME_PX = 960
_CYLINDER_FROM_FRAME = CylinderGeometry(720, 200, math.tan(math.radians(-25.0)), 0.9)
_PLANE_FROM_FRAME = PerspectiveGeometry(
    360, 270, math.radians(75.0), yaw_rad=math.radians(-25.0), pitch_rad=math.radians(-20.0)
)
# Step of the central difference along the profile, in t = tan(theta/2): the error is 1e-10.
_T_STEP = 1e-5


def draw_viewpoint(page: Page, inputs: FigureInputs) -> FigureCaption:
    """Draw the section with rays, and the two images made of a frame.

    Raises:
        DomainError: The mirror's camera has no pinhole, as a paraboloid's has not.
    """
    camera = inputs.subject.camera
    if not math.isfinite(camera.mirror.pinhole_distance_m):
        raise DomainError("the drawing of the viewpoint needs a capture camera with a pinhole")
    axes = add_axes(page, 120, 40, 640, 670)
    _draw_section(axes, camera)
    _draw_resampled_images(page, inputs.subject)
    return _caption(camera)


def reflection_miss_m(camera: OmniCamera, theta_rad: Floats) -> Floats:
    """Distance at which rays to the viewpoint pass the pinhole, by the law of reflection.

    The normal follows from the surface's points alone, by a central difference: the camera model
    takes no part.

    Args:
        camera: Camera with a pinhole.
        theta_rad: (n,) incidence angles of the rays.
    """
    t = np.tan(0.5 * theta_rad)
    mirror = _surface_point(camera, t)
    tangent = _surface_point(camera, t + _T_STEP) - _surface_point(camera, t - _T_STEP)
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    incoming = -np.stack((np.sin(theta_rad), np.cos(theta_rad)), axis=-1)
    # A mirror keeps the part along the tangent and reverses the rest.
    along = (incoming * tangent).sum(axis=-1, keepdims=True) * tangent
    reflected = 2.0 * along - incoming
    to_pinhole = np.array([0.0, camera.mirror.pinhole_distance_m]) - mirror
    cross = reflected[:, 0] * to_pinhole[:, 1] - reflected[:, 1] * to_pinhole[:, 0]
    miss: Floats = np.abs(cross)
    return miss


def _surface_point(camera: OmniCamera, t: Floats) -> Floats:
    """(..., 2) distance from the axis and z, down, of the mirror's profile."""
    return np.stack(camera.mirror.surface_point(t), axis=-1)


def _draw_section(axes: Axes, camera: OmniCamera) -> None:
    t = np.linspace(0.0, camera.rim_t, 200)
    profile_mm = 1e3 * _surface_point(camera, t)
    rim_mm, pinhole_mm = float(profile_mm[-1, 0]), 1e3 * camera.mirror.pinhole_distance_m
    for side in (-1.0, 1.0):
        axes.plot(side * profile_mm[:, 0], profile_mm[:, 1], color=FOREGROUND, lw=2.0)
    axes.plot([0, 0], [0, pinhole_mm], color=MUTED, lw=0.7, ls=(0, (8, 3, 1, 3)))
    for theta_deg in _CYLINDER_THETA_DEG:
        theta_rad = math.radians(theta_deg)
        length_mm = 1.12 * _CYLINDER_RADII * rim_mm / math.sin(theta_rad)
        _draw_ray(axes, camera, theta_rad, 1.0, length_mm)
    for theta_deg in _PLANE_THETA_DEG:
        _draw_ray(axes, camera, math.radians(theta_deg), -1.0, 1.15 * _PLANE_RADII * rim_mm)
    _draw_surfaces(axes, rim_mm)
    for z_mm, name, offset in (
        (0.0, "effective\nviewpoint", (-34, 40)),
        (pinhole_mm, "pinhole of the\ncapture camera", (14, 8)),
    ):
        axes.plot(0.0, z_mm, "o", color=FOREGROUND, ms=4, zorder=5)
        axes.annotate(name, (0.0, z_mm), offset, textcoords="offset points", va="center",
                      ha="left" if offset[0] > 0 else "right",
                      arrowprops={"arrowstyle": "-", "lw": 0.5, "shrinkB": 3})  # fmt: skip
    axes.set(aspect="equal", xlabel="distance from the mirror's axis, mm", ylabel="height, mm")
    # Heights grow upwards, as the camera stands: z is down in the mirror frame.
    axes.invert_yaxis()
    # 0.0 - z, as -0.0 would have a sign.
    axes.yaxis.set_major_formatter(lambda z_mm, _: f"{0.0 - z_mm:g}".replace("-", "−"))


def _draw_ray(
    axes: Axes, camera: OmniCamera, theta_rad: float, side: float, length_mm: float
) -> None:
    """Draw a ray from the scene to mirror and pinhole, and the aim at the viewpoint dotted."""
    mirror_mm = 1e3 * _surface_point(camera, np.array(math.tan(0.5 * theta_rad)))
    scene_mm = length_mm * np.array([math.sin(theta_rad), math.cos(theta_rad)])
    pinhole_mm = np.array([0.0, 1e3 * camera.mirror.pinhole_distance_m])
    ray = np.stack((scene_mm, mirror_mm, pinhole_mm)) * (side, 1.0)
    aim = np.stack((mirror_mm, np.zeros(2))) * (side, 1.0)
    axes.plot(*ray.T, color=ORANGE, lw=1.1)
    axes.plot(*aim.T, ":", color=ORANGE, lw=1.1)


def _draw_surfaces(axes: Axes, rim_mm: float) -> None:
    """Draw the sections of cylinder and plane where the rays pass."""
    radius = _CYLINDER_RADII * rim_mm
    rows = [radius / math.tan(math.radians(theta)) for theta in (50.0, 115.0)]
    axes.plot([radius, radius], rows, color=TEAL, lw=2.0)
    axes.text(radius, rows[1], "cylinder", color=TEAL, ha="center", va="bottom")
    middle = math.radians(62.0)
    normal = np.array([-math.sin(middle), math.cos(middle)])
    across = np.array([normal[1], -normal[0]])
    centre = _PLANE_RADII * rim_mm * 0.95 * normal
    ends = centre + np.outer((-0.45, 0.45), across) * _PLANE_RADII * rim_mm
    axes.plot(*ends.T, color=BLUE, lw=2.0)
    low = ends[np.argmax(ends[:, 1])]
    axes.text(*low, "plane", color=BLUE, ha="center", va="top")


def _draw_resampled_images(page: Page, subject: StudySubject) -> None:
    frame = subject.render_frame(_FRAME_PX, FIGURE_SAMPLES)
    camera = subject.resize_camera(frame.shape[0])
    left, top = 800, 70
    for geometry, title, colour in (
        (_CYLINDER_FROM_FRAME, "cylindrical image: all around, 25° above to 42° below",
         TEAL),
        (_PLANE_FROM_FRAME, "planar image: 75° wide, straight lines are straight",
         BLUE),
    ):  # fmt: skip
        image = unwarp(frame, make_unwarp_map(camera, geometry))
        add_text(page, left, top - 10, title, va="bottom", color=colour)
        width = 700 if image.shape[1] > 2 * image.shape[0] else 560
        show_image(page, image, left, top, width)
        top += round(width * image.shape[0] / image.shape[1]) + 70


def _caption(camera: OmniCamera) -> FigureCaption:
    theta_rad = np.radians(np.arange(5.0, math.degrees(camera.rim_rad), 5.0))
    miss_nm = 1e9 * float(reflection_miss_m(camera, theta_rad).max())
    pinhole_mm = 1e3 * camera.mirror.pinhole_distance_m
    return FigureCaption(
        title="The single effective viewpoint",
        caption=(
            f"Section through mirror and pinhole, {pinhole_mm:.1f} mm apart, to scale. Each ray "
            "that aims at the viewpoint (dotted) is reflected into the pinhole, by the law of "
            f"reflection at the mirror's surface, within {max(1, math.ceil(miss_nm))} nm. So a "
            "frame holds what a camera at the viewpoint would see: right, one frame resampled to "
            "a cylinder and to a plane."
        ),
        alt=(
            "A bowl-shaped mirror in section with a viewpoint inside and a pinhole below; rays "
            "cross a cylinder or a plane, meet the mirror and end in the pinhole. Beside it a "
            "panorama and a perspective image of the field."
        ),
        metrics={"pinhole_below_viewpoint_mm": round(pinhole_mm, 1)},
    )
