"""Discs at 0.15 to 3 m on every mirror, drawn by Mitsuba 3 and by the trace renderer.

Mitsuba gets the mirror as a smooth conductor: the ball is its own sphere, the others are meshes of
the publication's profile with its normals, under its own perspective or orthographic camera; each
disc is an emitter of its own. Mitsuba traces in single precision. Compared are centroids of light
in a window around each disc. Both sides are sampled: Mitsuba by seeds, the trace renderer by
regular grids that lie differently in the pixels; the spread of four of each is the standard error.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from catoptra_protocol.optics.camera_rays import pixel_from_point
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.renderer import PerPixel, RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Item, Material, Ring, World
from helpers.markers import disc_pose
from outside.findings import MUTATION, Finding, summarize, version_of
from outside.mirrors import (
    DISTANCES_M,
    HUB_RAD,
    MirrorCase,
    differentiate,
    reflect,
    scatter_points,
)

BOUND_PX = 0.02
MIN_AREA_PX = 4.0
# Half of the mutation: a scale that is wrong by 1e-4 is beyond, one that is right within.
SCALE_BOUND = 0.5 * MUTATION
WINDOW_PX = 20
_NUM_CANDIDATES, _PER_DISTANCE = 400, 8
# Samplings of each side; samples a pixel of Mitsuba's, and along a side of a pixel of ours.
_REPEATS, _SAMPLES, _GRID = 4, 144, 16
# Facets of 0.25 px and half a degree: their normals are interpolated, so they show no edges.
_RINGS, _SECTORS = 720, 720
# Mitsuba moves a ray's start off a surface by 9e-5 of its largest coordinate plus one: in metres
# that is 0.1 mm, or 0.04 px at 0.15 m. Its scene is in millimetres, about the mirror's middle.
_UNITS_PER_M = 1000.0
# Diameters in the image: areas of 5, 13 and 50 px^2.
_DIAMETERS_PX = (2.6, 4.0, 8.0)
_NEAR_MM = 1.0
_IN_HUB = ", innermost 8 degrees"


@dataclass(frozen=True, slots=True, eq=False)
class Disc:
    """A disc that faces the effective viewpoint."""

    centre: Floats
    """(3,) mirror frame, metres."""
    distance_m: float
    theta_rad: float
    radius_m: float
    corner: tuple[int, int]
    """First column and row of its window."""


@dataclass(frozen=True, slots=True, eq=False)
class Centroids:
    """Centroids of (n) discs in the image."""

    mean: Floats
    """(n, 2) pixels."""
    standard_errors: Floats
    """(n,) of the means, both coordinates together."""
    areas: Floats
    """(n,) light, in pixels of the disc."""


def scatter_discs(camera: OmniCamera) -> list[Disc]:
    """Discs whose windows lie within the rim and do not overlap."""
    points, theta = scatter_points(camera, _NUM_CANDIDATES, seed=7)
    pixels, valid = pixel_from_point(camera, points)
    radii = np.hypot(*(pixels - camera.centre_px).T)
    slopes = camera.radius_slope_px(np.tan(0.5 * theta))
    discs: list[Disc] = []
    for i in np.flatnonzero(valid):
        distance = float(np.linalg.norm(points[i]))
        count = sum(abs(disc.distance_m - distance) < 1e-9 for disc in discs)
        size = _DIAMETERS_PX[count % len(_DIAMETERS_PX)]
        half = 0.5 * size / math.sqrt(slopes[i] * radii[i] / math.sin(theta[i])) * distance
        column, row = np.floor(pixels[i] - 0.5 * WINDOW_PX).astype(int).tolist()
        gaps = [np.abs(np.subtract((column, row), disc.corner)).max() for disc in discs]
        within = radii[i] < camera.rim_radius_px - 0.5 * size - 2.0
        within &= 0 <= min(column, row) <= max(column, row) <= camera.width_px - WINDOW_PX
        if within and count < _PER_DISTANCE and min(gaps, default=WINDOW_PX) >= WINDOW_PX:
            discs.append(Disc(points[i], distance, float(theta[i]), half, (column, row)))
    return discs


def _find_centroids(discs: list[Disc], images: list[list[Floats]], shifts: Floats) -> Centroids:
    """Centroids of light in images of each disc's window, whose sampling is shifted by (m, 2)."""
    light = np.array(images, dtype=np.float64)
    v, u = np.mgrid[:WINDOW_PX, :WINDOW_PX] + 0.5
    areas = light.sum(axis=(2, 3))
    moments = np.stack([(place * light).sum(axis=(2, 3)) for place in (u, v)], axis=-1)
    corners = np.array([disc.corner for disc in discs])
    pixels = moments / areas[..., None] + corners[:, None] - shifts
    spread = pixels.std(axis=1, ddof=1) / math.sqrt(_REPEATS)
    return Centroids(pixels.mean(axis=1), np.hypot(*spread.T), areas.mean(axis=1))


def draw_ours(camera: OmniCamera, discs: list[Disc]) -> Centroids:
    """Centroids in pictures of the trace renderer in linear light, window by window."""
    white, items = Material((1.0, 1.0, 1.0), unlit=True), []
    for disc in discs:
        pose = disc_pose(disc.centre / disc.distance_m, disc.distance_m)
        items.append(Item("disc", Ring(0.0, disc.radius_m, sectors=240), pose, white))
    world = World("discs", tuple(items))
    renderer = TraceRenderer(build_scene(world), world, threads=1)
    settings = RenderSettings(PerPixel(), samples=_GRID)
    # One plan for all windows: rays need its samples alone, and a plan's faces cost a second.
    plan = plan_from_settings(settings, camera, kind=RendererKind.TRACE, reason="proof")
    # A window that begins elsewhere in the pixel has its samples elsewhere on the disc.
    shifts = np.array([(i, i * 3 % _REPEATS) for i in range(_REPEATS)]) / (_REPEATS * _GRID)

    def draw(disc: Disc, shift: Floats) -> Floats:
        u, v = (np.asarray(camera.centre_px) - disc.corner + shift).tolist()
        window = replace(camera, width_px=WINDOW_PX, height_px=WINDOW_PX, centre_px=(u, v))
        view = renderer.prepare(window, plan)
        light = view.render_linear(CameraState(Pose.identity()))[..., 0]
        view.close()
        return light

    images = [[draw(disc, shift) for shift in shifts] for disc in discs]
    renderer.close()
    return _find_centroids(discs, images, shifts)


@lru_cache(maxsize=1)
def draw_by_mitsuba(case: MirrorCase) -> tuple[list[Disc], Centroids]:
    """A mirror's discs, and their centroids in Mitsuba's pictures of the same windows."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    discs = scatter_discs(case.camera)
    scene: dict[str, Any] = {"type": "scene", "integrator": {"type": "path", "max_depth": 2},
                             "mirror": _mitsuba_mirror(mi, case)}  # fmt: skip
    light = {"type": "area", "radiance": {"type": "rgb", "value": 1.0}}
    for number, disc in enumerate(discs):
        pose = _look(mi, case, disc.centre, np.eye(3)[int(np.argmin(np.abs(disc.centre)))])
        scene[f"disc{number}"] = {"type": "disk", "emitter": light,
                                  "to_world": pose.scale(_UNITS_PER_M * disc.radius_m)}  # fmt: skip
    loaded = mi.load_dict(scene)
    images = []
    for number, disc in enumerate(discs):
        sensor = mi.load_dict(_mitsuba_camera(mi, case, disc))
        seeds = range(1000 * number, 1000 * number + _REPEATS)
        drawn = [mi.render(loaded, sensor=sensor, seed=seed, spp=_SAMPLES) for seed in seeds]
        images.append([np.array(image)[..., 0] for image in drawn])
    return discs, _find_centroids(discs, images, np.zeros((_REPEATS, 2)))


def _mitsuba_camera(mi: Any, case: MirrorCase, disc: Disc) -> dict[str, Any]:
    width = case.camera.width_px
    film = {
        "type": "hdrfilm", "width": width, "height": width, "rfilter": {"type": "box"},
        "crop_offset_x": disc.corner[0], "crop_offset_y": disc.corner[1],
        "crop_width": WINDOW_PX, "crop_height": WINDOW_PX,
        "pixel_format": "rgb", "component_format": "float32",
    }  # fmt: skip
    sensor = {"film": film, "sampler": {"type": "stratified"}, "near_clip": _NEAR_MM}
    half = 0.5 * width / case.surface.focal_px
    height = 0.1 if case.surface.is_telecentric else case.pinhole_m
    pose = _look(mi, case, np.array((0.0, 0.0, height)), np.eye(3)[0])
    if case.surface.is_telecentric:
        to_world = pose.scale([half * _UNITS_PER_M, half * _UNITS_PER_M, 1.0])
        return sensor | {"type": "orthographic", "to_world": to_world}
    fov = 2.0 * math.degrees(math.atan(half))
    return sensor | {"type": "perspective", "fov": fov, "to_world": pose}


def _look(mi: Any, case: MirrorCase, place: Floats, up: Floats) -> Any:
    """Mitsuba's pose at (3,) a place in the mirror frame that looks at the effective viewpoint."""
    middle = np.array((0.0, 0.0, _middle_m(case)))
    origin, target = _UNITS_PER_M * (place - middle), -_UNITS_PER_M * middle
    return mi.ScalarTransform4f().look_at(origin=list(origin), target=list(target), up=list(up))


def _middle_m(case: MirrorCase) -> float:
    """Height half-way between vertex and rim."""
    mirror = case.camera.mirror
    return float(mirror.surface_point(np.array((mirror.t_min, case.camera.rim_t)))[1].mean())


def _mitsuba_mirror(mi: Any, case: MirrorCase) -> Any:
    steel = {"type": "conductor", "material": "none"}
    surface, top = case.surface, case.pinhole_m - _middle_m(case)
    if case.name == "spherical":
        r, depth = surface.curve(np.array((0.5 * math.pi, 0.0)))
        return {"type": "sphere", "center": [0, 0, _UNITS_PER_M * (top - depth[0])],
                "radius": _UNITS_PER_M * float(r[0]), "bsdf": steel}  # fmt: skip
    r, depth, dr, dd = differentiate(surface, _rings(case))
    azimuth = 2.0 * math.pi * np.arange(_SECTORS) / _SECTORS

    def spread(across: Floats, along: Floats) -> Any:
        x, y = across[:, None] * np.cos(azimuth), across[:, None] * np.sin(azimuth)
        height = np.broadcast_to(along[:, None], x.shape)
        return np.stack((x, y, height), axis=-1).astype(np.float32).ravel()

    length = np.hypot(dr, dd)
    ring, sector = np.meshgrid(np.arange(_RINGS), np.arange(_SECTORS), indexing="ij")
    a, b = ring * _SECTORS + sector, ring * _SECTORS + (sector + 1) % _SECTORS
    faces = np.stack((a, a + _SECTORS, b, b, a + _SECTORS, b + _SECTORS), axis=-1)
    properties = mi.Properties()
    properties["mesh_bsdf"] = mi.load_dict(steel)
    mesh = mi.Mesh("mirror", len(r) * _SECTORS, faces.size // 3, has_vertex_normals=True,
                   props=properties)  # fmt: skip
    numbers = mi.traverse(mesh)
    numbers["vertex_positions"] = spread(_UNITS_PER_M * r, _UNITS_PER_M * (top - depth))
    numbers["vertex_normals"] = spread(dd / length, dr / length)
    numbers["faces"] = faces.astype(np.uint32).ravel()
    numbers.update()
    return mesh


def _rings(case: MirrorCase) -> Floats:
    """Parameters of the mesh's rings, at even image radii to a little beyond the rim."""
    fine = np.linspace(0.0, case.surface.last * (1.0 - 1e-9), 20_001)[1:]
    _, _, out_r, out_d = reflect(case.surface, fine)
    image = case.surface.image_radius_px(fine)
    rim = np.searchsorted(np.arctan2(out_r, -out_d), case.camera.rim_rad)
    end = min(1.02 * image[rim], image[-1])
    return np.interp(np.linspace(1e-6 * end, end, _RINGS + 1), image, fine)


def compare_discs(case: MirrorCase, camera: OmniCamera | None = None) -> Iterator[Finding]:
    """Compare our discs by a case's camera, or by a mutant, with Mitsuba's; last their scale."""
    discs, theirs = draw_by_mitsuba(case)
    ours, authority = draw_ours(camera or case.camera, discs), version_of("mitsuba")
    apart = ours.mean - theirs.mean
    theta = np.array([disc.theta_rad for disc in discs])
    distances = np.array([disc.distance_m for disc in discs])
    # A cone's image begins at the angle of its apex.
    hub_rad = 2.0 * math.atan(case.camera.projection.t_min) + HUB_RAD
    counted = (theirs.areas >= MIN_AREA_PX) & (theta >= hub_rad)
    rows = [(f" at {m:g} m", counted & (np.abs(distances - m) < 1e-9)) for m in DISTANCES_M]
    for name, chosen in (*rows, (_IN_HUB, theta < hub_rad)):
        if chosen.any():
            errors = [float(np.median(each.standard_errors[chosen])) for each in (theirs, ours)]
            bound = math.inf if name == _IN_HUB else BOUND_PX
            yield summarize(case.name + name, authority, np.hypot(*apart[chosen].T), bound, "px",
                            error=f"Mitsuba {errors[0]:.4f}, ours {errors[1]:.4f} px")  # fmt: skip
    # Radial scale: the least-squares factor from Mitsuba's positions about the centre to ours; a
    # shift by the inverse distance is Mitsuba's start off the surface.
    place = theirs.mean[counted] - case.camera.centre_px
    unit = place / np.linalg.norm(place, axis=1, keepdims=True)
    columns = np.stack((place.ravel(), (unit / distances[counted, None]).ravel()), axis=-1)
    fit, rest, _, _ = np.linalg.lstsq(columns, apart[counted].ravel(), rcond=None)
    variance = float(rest[0]) / (len(columns) - 2) * np.linalg.inv(columns.T @ columns)[0, 0]
    factor = abs(float(fit[0]))
    yield Finding(f"{case.name}, scale", authority, factor, factor, SCALE_BOUND, "",
                  len(place), f"{math.sqrt(variance):.1e}")  # fmt: skip
