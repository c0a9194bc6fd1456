"""Mirror, cube and meshes in space: the paper's Figures 3, 4 and 6, drawn to one scale.

Figures 4 and 6: left, the cube around the effective viewpoint with open near sides, the virtual
cameras' images on the walls, the mirror at the centre, and one ray to the pinhole. Right, the
mirror with the cube projected onto the surface from the viewpoint, and the resulting frame.
Figure 3: mirror meshes, with the exact profile below each.
"""

from __future__ import annotations

import math

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube_map import MIRROR_FROM_FACE_ROTATIONS, Face
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.world.mirror_mesh import (
    Tessellation,
    mirror_polygons,
    tessellation_from_polygon_count,
)
from catoptra_studies.camera_figures.figure_spec import FigureCaption, FigureInputs
from catoptra_studies.camera_figures.image_figures import FACES
from catoptra_studies.camera_figures.mirror_drawing import (
    Axonometry,
    draw_frame_with_borders,
    draw_textured_mirror,
    rim_points,
    rim_radius_m,
    shade,
)
from catoptra_studies.paper_values import PAPER_POLYGON_COUNTS
from catoptra_studies.plot_style import (
    FOREGROUND,
    MUTED,
    ORANGE,
    RED,
    Axes,
    Image,
    Page,
    add_axes,
    add_text,
    fill_polygons,
    label_box,
    show_skewed_image,
)

_VIEW_FROM_ABOVE = Axonometry.from_view_angles(azimuth_deg=147.0, elevation_deg=24.0)
# The cube has directions, but no size; half as large again as the mirror leaves room
# for the ray between both.
_CUBE_TO_RIM_RATIO = 1.55
# A ray to the open side, almost level, clear of mirror and walls.
_RAY_AZIMUTH_RAD, _RAY_THETA_RAD = math.radians(-62.0), math.radians(80.0)
_FACE_PX = 360


def draw_cube(page: Page, inputs: FigureInputs) -> FigureCaption:
    """Draw the cube with the mirror inside, the textured mirror, and the frame.

    Raises:
        DomainError: The mirror's camera has no pinhole, as a paraboloid's has not.
    """
    subject = inputs.subject
    camera = subject.camera
    if not math.isfinite(camera.mirror.pinhole_distance_m):
        raise DomainError("the drawing of mirror and cube needs a capture camera with a pinhole")
    face_images = {face: subject.render_face(face, _FACE_PX, samples=2) for face in FACES}
    rim_m = rim_radius_m(camera)
    axes = add_axes(page, 10, 20, 860, 1080)
    _draw_cube(axes, camera, face_images, _CUBE_TO_RIM_RATIO * rim_m)
    add_text(page, 910, 30, "the cube projected onto the mirror", fontweight="bold")
    draw_textured_mirror(page, camera, face_images, left=930, top=86, width=540)
    add_text(page, 910, 580, "the capture camera's view of the mirror", fontweight="bold")
    draw_frame_with_borders(page, subject, left=960, top=628, width=480)
    return _caption_cube(camera, rim_m)


def _draw_cube(
    axes: Axes, camera: OmniCamera, face_images: dict[Face, Image], half_m: float
) -> None:
    # Far walls first, then edges, mirror and ray over them: the painter's order of this view.
    for face in (Face.C, Face.N, Face.W):
        # Columns of the plane: right, down, and the centre of the face.
        plane = half_m * MIRROR_FROM_FACE_ROTATIONS[face][:, (1, 2, 0)]
        data_from_unit = _VIEW_FROM_ABOVE.viewer_from_mirror[:2] @ plane
        show_skewed_image(axes, face_images[face], data_from_unit)
    _draw_edges(axes, half_m)
    _draw_mirror(axes, camera)
    _draw_ray(axes, camera, half_m)
    _label_faces(axes, half_m)
    low = _VIEW_FROM_ABOVE.project(np.array([0.0, 0.0, camera.mirror.pinhole_distance_m]))[1]
    axes.set(
        xlim=(-1.55 * half_m, 1.55 * half_m), ylim=(low - 0.25 * half_m, 1.62 * half_m),
        aspect="equal", anchor="N",
    )  # fmt: skip
    axes.axis("off")


def _draw_edges(axes: Axes, half_m: float) -> None:
    """Draw the twelve edges, dashed along the open near sides and the missing top."""
    for axis in range(3):
        for first in (-1.0, 1.0):
            for second in (-1.0, 1.0):
                ends = np.full((2, 3), half_m)
                ends[:, axis] *= (-1.0, 1.0)
                ends[:, (axis + 1) % 3] *= first
                ends[:, (axis + 2) % 3] *= second
                # An edge of a drawn wall (N: +x, W: -y, C: +z) has the midpoint on that side.
                midpoint = ends.mean(axis=0)
                is_on_wall = midpoint[0] > 0.0 or midpoint[1] < 0.0 or midpoint[2] > 0.0
                axes.plot(
                    *_VIEW_FROM_ABOVE.project(ends).T,
                    color=FOREGROUND,
                    linewidth=0.8,
                    linestyle=(0, ()) if is_on_wall else (0, (4, 3)),
                )


def _draw_mirror(axes: Axes, camera: OmniCamera) -> None:
    """Draw the mirror from above: the dull back inside, the reflecting side outside."""
    polygons = mirror_polygons(camera, Tessellation(72, 24))
    polygons = polygons[_VIEW_FROM_ABOVE.depth_order(polygons)]
    normals = _VIEW_FROM_ABOVE.normals(polygons)
    is_reflecting = normals[:, 2:] > 0.0
    brightness = shade(np.where(is_reflecting, normals, -normals))[:, None]
    colours = brightness * np.where(is_reflecting, (0.62, 0.74, 0.86), (0.80, 0.80, 0.78)) * 1.15
    fill_polygons(axes, _VIEW_FROM_ABOVE.project(polygons), np.clip(colours, 0.0, 1.0))


def _draw_ray(axes: Axes, camera: OmniCamera, half_m: float) -> None:
    """Draw a ray from the cube's wall to the mirror and the pinhole, with the aim dotted."""
    level = np.array([math.cos(_RAY_AZIMUTH_RAD), math.sin(_RAY_AZIMUTH_RAD), 0.0])
    down = np.eye(3)[2]
    direction = math.sin(_RAY_THETA_RAD) * level + math.cos(_RAY_THETA_RAD) * down
    r, z = camera.mirror.surface_point(np.array(math.tan(0.5 * _RAY_THETA_RAD)))
    mirror = float(r) * level + float(z) * down
    wall = half_m * direction / np.abs(direction).max()
    viewpoint = np.zeros(3)
    pinhole = np.array([0.0, 0.0, camera.mirror.pinhole_distance_m])
    project = _VIEW_FROM_ABOVE.project
    ray, aim = project(np.stack((wall, mirror, pinhole))), project(np.stack((mirror, viewpoint)))
    axis = project(np.stack((viewpoint, pinhole)))
    axes.plot(*ray.T, color=ORANGE, linewidth=1.6)
    axes.plot(*aim.T, ":", color=ORANGE)
    axes.plot(*axis.T, color=MUTED, linewidth=0.7, linestyle=(0, (8, 3, 1, 3)))
    for point, name, offset in (
        (viewpoint, "effective\nviewpoint", (64, -106)),
        (pinhole, "pinhole of the\ncapture camera", (14, -4)),
        (wall, "a point of\nthe scene", (-34, -122)),
    ):
        axes.plot(*project(point), "o", color=FOREGROUND, markersize=4)
        _annotate_point(axes, project(point), name, offset)
    rim = np.array([*(0.9 * float(r) * -level[:2]), -0.8 * float(r)])
    _annotate_point(axes, project(rim), "mirror", (40, 92))


def _annotate_point(axes: Axes, point: Floats, name: str, offset: tuple[float, float]) -> None:
    box = label_box(1.5, alpha=0.85)
    line = {"arrowstyle": "-", "color": FOREGROUND, "linewidth": 0.5, "shrinkB": 2}
    axes.annotate(
        name, point, offset, textcoords="offset points", va="center",
        ha="left" if offset[0] > 0 else "right", bbox=box, arrowprops=line,
    )  # fmt: skip


def _label_faces(axes: Axes, half_m: float) -> None:
    # Coordinates on the face, near the corner that the mirror does not hide.
    corners = {Face.N: (0.8, 0.82), Face.W: (-0.8, 0.82), Face.C: (0.0, 0.8)}
    box = label_box(2)
    for face, (s, t) in corners.items():
        point = half_m * MIRROR_FROM_FACE_ROTATIONS[face] @ np.array([1.0, s, t])
        axes.text(
            *_VIEW_FROM_ABOVE.project(point), face.name, fontweight="bold", ha="center",
            va="center", bbox=box,
        )  # fmt: skip


def _caption_cube(camera: OmniCamera, rim_m: float) -> FigureCaption:
    metrics = {
        "mirror_diameter_mm": round(2e3 * rim_m, 1),
        "pinhole_below_viewpoint_mm": round(1e3 * camera.mirror.pinhole_distance_m, 1),
    }
    return FigureCaption(
        title="Cube, mirror and frame",
        caption=(
            "A ray that aims at the effective viewpoint is reflected into the pinhole, "
            f"{metrics['pinhole_below_viewpoint_mm']:.0f} mm below it. So each point of the mirror "
            f"of {metrics['mirror_diameter_mm']:.0f} mm shows the cube's colour in its direction "
            "from the viewpoint: that is the UV mapping."
        ),
        alt=(
            "A cube with camera images on its walls and a bowl-shaped mirror at its centre; a "
            "ray goes from a wall to the mirror and down to the pinhole. Beside it the mirror "
            "from below with the images on it, and the round frame with the cube's edges."
        ),
        metrics=metrics,
    )


# From the side of the capture camera, where the mirror is convex.
_VIEW_FROM_BELOW = Axonometry.from_view_angles(azimuth_deg=160.0, elevation_deg=-38.0)
_MIRROR_COLOUR = np.array([0.62, 0.72, 0.82])
_PANEL_WIDTH_PX = 370


def draw_meshes(page: Page, inputs: FigureInputs) -> FigureCaption:
    """Draw the four meshes, each above a cross section."""
    camera = inputs.subject.camera
    for column, count in enumerate(PAPER_POLYGON_COUNTS):
        tessellation = tessellation_from_polygon_count(count)
        left = 20 + column * _PANEL_WIDTH_PX
        title = f"{count} polygons, {tessellation.sectors} × {tessellation.rings}"
        centre = left + _PANEL_WIDTH_PX / 2
        add_text(page, centre, 20, title, fontweight="bold", ha="center", va="top")
        mesh_axes = add_axes(page, left, 70, _PANEL_WIDTH_PX, 270)
        _draw_mesh(mesh_axes, camera, tessellation)
        section_axes = add_axes(page, left + 15, 370, _PANEL_WIDTH_PX - 30, 170)
        _draw_cross_section(section_axes, camera, tessellation)
    add_text(
        page, 30, 566,
        "upright section through the mirror: left along corners, right along centres of sectors",
        color=MUTED,
    )  # fmt: skip
    add_text(page, 1490, 566, "exact surface", color=RED, ha="right")
    return _caption_meshes(camera)


def _draw_mesh(axes: Axes, camera: OmniCamera, tessellation: Tessellation) -> None:
    polygons = mirror_polygons(camera, tessellation)
    order = _VIEW_FROM_BELOW.depth_order(polygons)
    normals = _VIEW_FROM_BELOW.normals(polygons)
    # From below the back of the far rim would cover the reflecting side.
    order = order[normals[order, 2] > 0.0]
    colours = np.clip(shade(normals[order])[:, None] * _MIRROR_COLOUR * 1.15, 0.0, 1.0)
    fill_polygons(
        axes,
        _VIEW_FROM_BELOW.project(polygons[order]),
        colours,
        edge=FOREGROUND,
        line=_edge_width(tessellation.num_polygons),
    )
    rim = _VIEW_FROM_BELOW.project(rim_points(camera))
    axes.plot(*rim.T, color=RED, linewidth=1.2, zorder=0)
    half = 1.06 * float(np.abs(rim[:, 0]).max())
    low = float(_VIEW_FROM_BELOW.project(polygons.reshape(-1, 3))[:, 1].min())
    axes.set(xlim=(-half, half), ylim=(1.06 * low, 1.06 * float(rim[:, 1].max())), aspect="equal")
    axes.axis("off")


def _edge_width(num_polygons: int) -> float:
    """Width of the edges in points: thinner lines where a fine mesh would turn black."""
    if num_polygons < 100:
        return 0.9
    return 0.5 if num_polygons <= 1000 else 0.25


def _draw_cross_section(axes: Axes, camera: OmniCamera, tessellation: Tessellation) -> None:
    """Draw the upright section in millimetres: chords of the mesh against the exact surface."""
    r, z = camera.mirror.surface_point(np.linspace(0.0, camera.rim_t, 100))
    r_mm, z_mm = 1e3 * np.concatenate((-r[::-1], r)), 1e3 * np.concatenate((z[::-1], z))
    # One polygon of each ring; corners 1 and 2 are the inner and outer end on one side.
    corners = mirror_polygons(camera, tessellation)[:: tessellation.sectors]
    inner, outer = corners[:, 1], corners[:, 2]
    chord = np.concatenate((inner[:1], outer))
    chord_r_mm = 1e3 * np.linalg.norm(chord[:, :2], axis=-1)
    # Half a sector further a polygon's edge is nearer the axis, by the apothem of the n-gon.
    apothem_ratio = math.cos(math.pi / tessellation.sectors)
    axes.fill_between(r_mm, z_mm, z_mm.min(), color="#eef1f4", linewidth=0)
    axes.plot(r_mm, z_mm, color=RED, linewidth=1.0)
    style = {"color": FOREGROUND, "linewidth": 0.8, "markersize": 3}
    for x_mm in (-chord_r_mm, apothem_ratio * chord_r_mm):
        axes.plot(x_mm, 1e3 * chord[:, 2], ".-", **style)
    axes.axvline(0.0, color=MUTED, linewidth=0.6, linestyle=(0, (6, 2, 1, 2)))
    axes.set(aspect="equal", anchor="S")
    axes.invert_yaxis()
    axes.axis("off")


def _caption_meshes(camera: OmniCamera) -> FigureCaption:
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
