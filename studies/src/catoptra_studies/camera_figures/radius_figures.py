"""Image radius over the incidence angle: measured in an image, by the camera model, by Eq. 2.

The paper's Figure 7 shows rings of incidence and says that the image concurs with Eq. 2. Their
radii are measured in the pixels alone: the image is sampled along straight lines from the centre, a
ring is a dark interval of a line, and the centroid of the darkness is the radius. The radii follow
the camera model; Eq. 2 stays within a pixel of both.

Eq. 2 is exact for a paraboloid before an orthographic camera. For the hyperboloid before a pinhole
the deviation is h t kappa^2 (t^2 - 1) / (1 - kappa^2 t^2), computed without any image.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.mirrors.hyperbolic import eq2_radius_ratio_from_t
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.world.world_description import linear_from_srgb
from catoptra_studies.camera_figures.figure_spec import FigureCaption, FigureInputs
from catoptra_studies.paper_values import PAPER_SIZE_PX
from catoptra_studies.plot_style import (
    BLUE,
    FOREGROUND,
    LIGHT_GREY,
    ORANGE,
    RED,
    TEAL,
    Axes,
    Image,
    Page,
    add_axes,
    label_box,
    show_image,
)

NUM_SECTORS = 24
# One line is good to 0.2 px, since pixels alias a ring of hardly their own width; the
# mean of a sector's lines removes most of that.
_LINES_PER_SECTOR = 15
_STEP_PX = 0.05
# A twentieth of full contrast, below which there is only the white between the rings.
_DARKNESS_THRESHOLD = 0.05
# The black outside reaches two pixels inwards: one by interpolation, one in the rim's own pixel.
_RIM_MARGIN_PX = 2.0


def measure_ring_radii(image: Image, *, rim_radius_px: float) -> Floats:
    """Measure the radii of all rings about the image's centre.

    Args:
        image: Frame of dark rings on white.
        rim_radius_px: Radius of the mirror's rim; the search ends just before.

    Returns:
        (NUM_SECTORS, rings) radii in pixels, from the inmost ring outwards.

    Raises:
        CatoptraError: Not every line crosses the same number of rings.
    """
    # Green is dark in the grey rings and in the red one. Linear light, because a pixel averages
    # light, and the centroid of an encoded average would be displaced.
    intensity = linear_from_srgb(image[..., 1] / 255.0)
    radius = np.arange(0.0, rim_radius_px - _RIM_MARGIN_PX, _STEP_PX)
    num_lines = NUM_SECTORS * _LINES_PER_SECTOR
    azimuth = 2.0 * math.pi * (np.arange(num_lines) + 0.5) / num_lines
    u = 0.5 * image.shape[1] + np.outer(np.cos(azimuth), radius)
    v = 0.5 * image.shape[0] + np.outer(np.sin(azimuth), radius)
    darkness = 1.0 - _interpolate(intensity, u, v) / intensity.max()
    centroids = [_centroids(radius, line) for line in darkness]
    counts = {len(line) for line in centroids}
    if len(counts) != 1 or not min(counts):
        raise CatoptraError(
            f"{min(counts)} to {max(counts)} rings found along {num_lines} lines in an image "
            f"{image.shape[1]} px wide: --rings-world must be a world of closed rings around the "
            "robot's first start, such as configs/worlds/incidence_rings.ini"
        )
    radii: Floats = np.array(centroids).reshape(NUM_SECTORS, _LINES_PER_SECTOR, -1).mean(axis=1)
    return radii


def _centroids(radius: Floats, darkness: Floats) -> Floats:
    """Centroid of every dark interval that lies wholly on the line."""
    # A False at both ends makes every interval begin and end inside the array.
    is_dark = np.concatenate(([False], darkness > _DARKNESS_THRESHOLD, [False]))
    begins = np.flatnonzero(is_dark[1:] & ~is_dark[:-1])
    ends = np.flatnonzero(is_dark[:-1] & ~is_dark[1:])
    is_whole = (begins > 0) & (ends < len(radius))
    intervals = [slice(b, e) for b, e in zip(begins[is_whole], ends[is_whole], strict=True)]
    return np.array(
        [np.average(radius[interval], weights=darkness[interval]) for interval in intervals]
    )


def _interpolate(intensity: Floats, u: Floats, v: Floats) -> Floats:
    """Bilinear interpolation between pixel centres, which are at +0.5, at (...) positions."""
    column, row = np.floor(u - 0.5).astype(int), np.floor(v - 0.5).astype(int)
    a, b = u - 0.5 - column, v - 0.5 - row
    upper = (1.0 - a) * intensity[row, column] + a * intensity[row, column + 1]
    lower = (1.0 - a) * intensity[row + 1, column] + a * intensity[row + 1, column + 1]
    value: Floats = (1.0 - b) * upper + b * lower
    return value


# The world has a circle every five degrees, the first at five.
_SPACING_DEG = 5.0
# A ring is hardly wider than a pixel, and the radius is measured to 0.02 px.
_SAMPLES = 6
_IMAGE_WIDTH_PX = 2 * PAPER_SIZE_PX


def draw_rings(page: Page, inputs: FigureInputs) -> FigureCaption:
    """Draw the rings, their measured radii, and the deviations from camera model and Eq. 2."""
    # Always at the paper's size: the radii are measured in pixels.
    image = inputs.rings.render_frame(PAPER_SIZE_PX, _SAMPLES)
    camera = inputs.rings.resize_camera(PAPER_SIZE_PX)
    measured = measure_ring_radii(image, rim_radius_px=camera.rim_radius_px)
    theta_deg = _SPACING_DEG * np.arange(1, measured.shape[1] + 1)
    t = np.tan(np.radians(0.5 * theta_deg))
    exact = camera.scale_px * camera.projection.radius_ratio_from_t(t)
    eq2 = camera.horizon_radius_px * eq2_radius_ratio_from_t(t)
    axes = show_image(page, image, 20, 40, _IMAGE_WIDTH_PX)
    _label_rings(axes, theta_deg, exact)
    _draw_radii(page, theta_deg, measured, exact)
    _draw_deviations(page, theta_deg, measured - exact, eq2 - exact)
    return _caption_rings(theta_deg, measured, exact, eq2)


def _label_rings(axes: Axes, theta_deg: Floats, radius_px: Floats) -> None:
    centre = 0.5 * PAPER_SIZE_PX
    diagonal = math.cos(math.radians(-45)), math.sin(math.radians(-45))
    box = label_box(0.8)
    for theta, radius in zip(theta_deg, radius_px, strict=True):
        # A number at every ring would hide the rings.
        if theta % 30 == 0:
            colour = RED if theta == 90 else FOREGROUND
            axes.text(
                centre + radius * diagonal[0], centre + radius * diagonal[1], f"{theta:.0f}°",
                ha="center", va="center", fontsize=7.5, color=colour, bbox=box,
            )  # fmt: skip


def _draw_radii(page: Page, theta_deg: Floats, measured: Floats, exact: Floats) -> None:
    axes = add_axes(page, 860, 60, 620, 320)
    axes.plot(theta_deg, exact, color=BLUE, label="camera model")
    points = {"color": FOREGROUND, "markersize": 2.6}
    axes.plot(theta_deg, measured.mean(axis=0), "o", label="measured", **points)
    axes.axvline(90.0, color=RED, linewidth=0.8)
    axes.set(xlim=(0, 120), ylim=(0, 180), xticks=range(0, 121, 30), yticks=range(0, 181, 60))
    axes.set_title("image radius $r_i$, px", loc="left", fontsize=8.5)
    axes.tick_params(labelbottom=False)
    axes.legend(loc="upper left")


def _draw_deviations(
    page: Page, theta_deg: Floats, measured_deviation: Floats, eq2_deviation: Floats
) -> None:
    axes = add_axes(page, 860, 460, 620, 250)
    # The band spans all sectors of a ring, the points are their means.
    low, high = measured_deviation.min(axis=0), measured_deviation.max(axis=0)
    axes.fill_between(theta_deg, low, high, color=LIGHT_GREY, linewidth=0)
    points = {"color": FOREGROUND, "markersize": 2.6}
    axes.plot(theta_deg, measured_deviation.mean(axis=0), "o", **points)
    axes.plot(theta_deg, eq2_deviation, "--", color=ORANGE)
    axes.axhline(0.0, color=BLUE)
    axes.axvline(90.0, color=RED, linewidth=0.8)
    axes.set(xlim=(0, 120), xticks=range(0, 121, 30), xlabel="incidence angle θ, degrees")
    axes.set_title("deviation from the camera model, px", loc="left", fontsize=8.5)
    axes.annotate("Eq. 2", (theta_deg[-1], eq2_deviation[-1]), (-8, 0),
                  textcoords="offset points", ha="right", color=ORANGE)  # fmt: skip
    axes.annotate("measured", (45.0, measured_deviation.min()), (0, -3),
                  textcoords="offset points", ha="center", va="top")  # fmt: skip


def _caption_rings(
    theta_deg: Floats, measured: Floats, exact: Floats, eq2: Floats
) -> FigureCaption:
    rings = measured.mean(axis=0)
    metrics = {
        "rings": len(theta_deg),
        "sectors": NUM_SECTORS,
        "eq2_worst_deg": float(theta_deg[np.argmax(np.abs(rings - eq2))]),
        "exact_max_px": round(float(np.abs(rings - exact).max()), 3),
        "exact_max_of_any_sector_px": round(float(np.abs(measured - exact).max()), 3),
        "eq2_max_px": round(float(np.abs(rings - eq2).max()), 3),
    }
    return FigureCaption(
        title="Incidence angles, rendered and measured",
        caption=(
            f"A circle every 5° of incidence, red at 90°. The radii of {metrics['rings']} rings, "
            f"measured in the pixels of this {PAPER_SIZE_PX} px image, lie within "
            f"{metrics['exact_max_px']:.3f} px of the camera model (any of {NUM_SECTORS} "
            f"sectors: {metrics['exact_max_of_any_sector_px']:.3f} px, grey) and up to "
            f"{metrics['eq2_max_px']:.3f} px from the paper's Eq. 2, at "
            f"{metrics['eq2_worst_deg']:.0f}°."
        ),
        alt=(
            "Concentric rings in the mirror, the 90 degree one red; beside it the measured radii "
            "on the camera model's curve, and below the small deviations: measured around zero, "
            "Eq. 2 bending away beyond 90 degrees."
        ),
        metrics=metrics,
    )


def eq2_deviation_px(camera: OmniCamera, theta_rad: Floats) -> tuple[Floats, Floats]:
    """Exact image radius minus Eq. 2, with both ways to scale Eq. 2.

    Args:
        camera: Camera with a mirror of any shape.
        theta_rad: (...) incidence angles from 0 to the camera's rim.

    Returns:
        (...) deviations with the same radius of the horizon, and with the same radius of the rim.
    """
    t = np.tan(0.5 * theta_rad)
    exact = camera.scale_px * camera.projection.radius_ratio_from_t(t)
    eq2 = eq2_radius_ratio_from_t(t)
    # Eq. 2 has no rim: the fit to the mirror can be at the horizon or at the rim.
    rim_eq2 = float(eq2_radius_ratio_from_t(np.array(camera.rim_t)))
    return exact - camera.horizon_radius_px * eq2, exact - camera.rim_radius_px / rim_eq2 * eq2


def draw_eq2(page: Page, inputs: FigureInputs) -> FigureCaption:
    """Draw both deviations over the incidence angle."""
    camera = inputs.subject.resize_camera(PAPER_SIZE_PX)
    rim_deg = math.degrees(camera.rim_rad)
    # The rim itself is appended: rounding may put the last step of arange on either side.
    theta_deg = np.append(np.arange(0.0, rim_deg, 0.25), rim_deg)
    same_h, same_rim = eq2_deviation_px(camera, np.radians(theta_deg))
    axes = add_axes(page, 120, 50, 1360, 480)
    axes.axhline(0.0, color=BLUE)
    axes.axvline(90.0, color=RED, linewidth=0.8)
    axes.plot(theta_deg, same_h, color=ORANGE)
    axes.plot(theta_deg, same_rim, color=TEAL)
    axes.set(xlim=(0, rim_deg), xticks=np.arange(0, rim_deg + 1, 15))
    # Room for the labels at both extremes.
    axes.margins(y=0.12)
    axes.set_xlabel("incidence angle θ, degrees")
    axes.set_title("exact $r_i$ − Eq. 2, px", loc="left", fontsize=8.5)
    axes.text(89.0, axes.get_ylim()[1], "horizon", color=RED, ha="right", va="top")
    _label_maximum(axes, theta_deg, same_h, "same 90° circle", ORANGE, "right")
    _label_maximum(axes, theta_deg, same_rim, "same rim", TEAL, "left")
    return _caption_eq2(rim_deg, same_h, same_rim)


def _label_maximum(
    axes: Axes, theta_deg: Floats, deviation: Floats, name: str, colour: str, side: str
) -> None:
    index = int(np.argmax(np.abs(deviation)))
    axes.plot(theta_deg[index], deviation[index], "o", color=colour, markersize=4, clip_on=False)
    axes.annotate(
        f"{name}:\n{abs(deviation[index]):.3f} px at {theta_deg[index]:.0f}°",
        (theta_deg[index], deviation[index]),
        (-9, 0) if side == "right" else (5, 14),
        textcoords="offset points",
        ha=side,
        va="center" if side == "right" else "bottom",
        color=colour,
    )


def _caption_eq2(rim_deg: float, same_h: Floats, same_rim: Floats) -> FigureCaption:
    metrics = {
        "rim_deg": round(rim_deg, 3),
        "same_h_max_px": round(float(np.abs(same_h).max()), 4),
        "same_rim_max_px": round(float(np.abs(same_rim).max()), 4),
    }
    return FigureCaption(
        title="Equation 2 against the mirror's own projection",
        caption=(
            "Eq. 2 belongs to a parabolic mirror; the paper's is hyperbolic. In a "
            f"{PAPER_SIZE_PX} px image the two differ by up to {metrics['same_h_max_px']:.3f} px "
            f"with the same 90° circle, by {metrics['same_rim_max_px']:.3f} px with the same rim: "
            "too little to see, enough to measure."
        ),
        alt=(
            "Two curves of the difference in pixels over the incidence angle: one is zero at the "
            "horizon and grows towards the rim, the other is zero at the rim and deepest near "
            "the horizon."
        ),
        metrics=metrics,
    )
