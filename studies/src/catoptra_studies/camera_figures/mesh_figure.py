"""Mirror meshes in space: the paper's Figure 3, with the exact profile below each."""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.scene.mirror_mesh import (
    Tessellation,
    mirror_polygons,
    tessellation_from_polygon_count,
)
from catoptra_studies import plot_style
from catoptra_studies.camera_figures.axonometry import Axonometry, shade
from catoptra_studies.camera_figures.figure_spec import FigureCaption, FigureInputs
from catoptra_studies.paper_values import PAPER_POLYGON_COUNTS

# From the side of the capture camera, where the mirror is convex.
_VIEW_FROM_BELOW = Axonometry.from_view_angles(azimuth_deg=160.0, elevation_deg=-38.0)
_MIRROR_COLOUR = np.array([0.62, 0.72, 0.82])
_PANEL_WIDTH_PX = 370


def draw_meshes(page: plot_style.Page, inputs: FigureInputs) -> FigureCaption:
    """Draw the four meshes, each above its cross section."""
    camera = inputs.subject.camera
    for column, count in enumerate(PAPER_POLYGON_COUNTS):
        tessellation = tessellation_from_polygon_count(count)
        left = 20 + column * _PANEL_WIDTH_PX
        title = f"{count} polygons, {tessellation.sectors} × {tessellation.rings}"
        centre = left + _PANEL_WIDTH_PX / 2
        plot_style.add_text(page, centre, 20, title, fontweight="bold", ha="center", va="top")
        mesh_axes = plot_style.add_axes(page, left, 70, _PANEL_WIDTH_PX, 270)
        _draw_mesh(mesh_axes, camera, tessellation)
        section_axes = plot_style.add_axes(page, left + 15, 370, _PANEL_WIDTH_PX - 30, 170)
        _draw_cross_section(section_axes, camera, tessellation)
    plot_style.add_text(
        page, 30, 566,
        "upright section through the mirror: left along corners, right along centres of sectors",
        color=plot_style.MUTED,
    )  # fmt: skip
    plot_style.add_text(page, 1490, 566, "exact surface", color=plot_style.RED, ha="right")
    return _caption(camera)


def _draw_mesh(axes: plot_style.Axes, camera: OmniCamera, tessellation: Tessellation) -> None:
    polygons = mirror_polygons(camera, tessellation)
    order = _VIEW_FROM_BELOW.depth_order(polygons)
    normals = _VIEW_FROM_BELOW.normals(polygons)
    # From below the far part of the rim shows its back, which would cover the reflecting side.
    order = order[normals[order, 2] > 0.0]
    colours = np.clip(shade(normals[order])[:, None] * _MIRROR_COLOUR * 1.15, 0.0, 1.0)
    plot_style.fill_polygons(
        axes,
        _VIEW_FROM_BELOW.project(polygons[order]),
        colours,
        edge=plot_style.FOREGROUND,
        line=_edge_width(tessellation.num_polygons),
    )
    azimuth_rad = np.linspace(0.0, 2.0 * math.pi, 181)
    rim = _surface_points(camera, np.full(181, camera.rim_t), azimuth_rad)
    rim = _VIEW_FROM_BELOW.project(rim)
    axes.plot(*rim.T, color=plot_style.RED, linewidth=1.2, zorder=0)
    half = 1.06 * float(np.abs(rim[:, 0]).max())
    low = float(_VIEW_FROM_BELOW.project(polygons.reshape(-1, 3))[:, 1].min())
    axes.set(xlim=(-half, half), ylim=(1.06 * low, 1.06 * float(rim[:, 1].max())), aspect="equal")
    axes.axis("off")


def _edge_width(num_polygons: int) -> float:
    """Width of the edges in points: thinner lines where a fine mesh would turn black."""
    if num_polygons < 100:
        return 0.9
    return 0.5 if num_polygons <= 1000 else 0.25


def _surface_points(camera: OmniCamera, t: Floats, azimuth_rad: Floats) -> Floats:
    """(..., 3) points of the exact mirror at t = tan(theta/2)."""
    r, z = camera.mirror.surface_point(t)
    return np.stack((r * np.cos(azimuth_rad), r * np.sin(azimuth_rad), z), axis=-1)


def _draw_cross_section(
    axes: plot_style.Axes, camera: OmniCamera, tessellation: Tessellation
) -> None:
    """Draw the upright section in millimetres: chords of the mesh beside the exact surface."""
    r, z = camera.mirror.surface_point(np.linspace(0.0, camera.rim_t, 100))
    r_mm, z_mm = 1e3 * np.concatenate((-r[::-1], r)), 1e3 * np.concatenate((z[::-1], z))
    # One polygon of each ring; corners 1 and 2 are its inner and outer end on one side.
    corners = mirror_polygons(camera, tessellation)[:: tessellation.sectors]
    inner, outer = corners[:, 1], corners[:, 2]
    chord = np.concatenate((inner[:1], outer))
    chord_r_mm = 1e3 * np.linalg.norm(chord[:, :2], axis=-1)
    # Half a sector further a polygon's edge is nearer the axis, by the apothem of the n-gon.
    apothem_ratio = math.cos(math.pi / tessellation.sectors)
    axes.fill_between(r_mm, z_mm, z_mm.min(), color="#eef1f4", linewidth=0)
    axes.plot(r_mm, z_mm, color=plot_style.RED, linewidth=1.0)
    style = {"color": plot_style.FOREGROUND, "linewidth": 0.8, "markersize": 3}
    for x_mm in (-chord_r_mm, apothem_ratio * chord_r_mm):
        axes.plot(x_mm, 1e3 * chord[:, 2], ".-", **style)
    axes.axvline(0.0, color=plot_style.MUTED, linewidth=0.6, linestyle=(0, (6, 2, 1, 2)))
    axes.set(aspect="equal", anchor="S")
    axes.invert_yaxis()
    axes.axis("off")


def _caption(camera: OmniCamera) -> FigureCaption:
    rim_r, rim_z = camera.mirror.surface_point(np.array(camera.rim_t))
    _, vertex_z = camera.mirror.surface_point(np.array(0.0))
    metrics = {
        "diameter_mm": round(2e3 * float(rim_r), 2),
        "depth_mm": round(1e3 * float(vertex_z - rim_z), 2),
        **{f"polygons_{i + 1}": count for i, count in enumerate(PAPER_POLYGON_COUNTS)},
    }
    return FigureCaption(
        title="The mirror as a mesh",
        caption=(
            "The mirror of Eq. 1 divided into 16, 64, 256 and 1024 polygons (sectors × rings), "
            f"from below. It measures {metrics['diameter_mm']:.1f} mm across and "
            f"{metrics['depth_mm']:.1f} mm in depth. Below, in red, the exact surface: flat "
            "polygons lie inside it and do not reach its round rim."
        ),
        alt=(
            "Four drawings of a convex bowl from below, made of ever more flat polygons; under "
            "each its profile against the exact curve, on which the finest one lies."
        ),
        metrics=metrics,
    )
