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
from outside.findings import MUTATION, Finding, summarize, version_of
from outside.mirrors import DISTANCES_M, HUB_RAD, MirrorCase, reflect

BOUND_PX = 0.02
MIN_AREA_PX = 4.0
# Half of the mutation: a scale that is wrong by 1e-4 is beyond, one that is right within.
SCALE_BOUND = 0.5 * MUTATION
WINDOW_PX = 20
_NUM_CANDIDATES = 400
_REPEATS = 4
_GRID = 16
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
    radius_m: float
    corner: tuple[int, int]
    """First column and row of its window."""
    theta_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class Centroids:
    """Centroids of (n) discs in the image by (m) samplings."""

    pixels: Floats
    """(m, n, 2)."""
    areas: Floats
    """(n,) light, in pixels of the disc."""

    @property
    def mean(self) -> Floats:
        """(n, 2) centroids."""
        return np.asarray(self.pixels.mean(axis=0))

    @property
    def standard_errors(self) -> Floats:
        """(n,) of the means, both coordinates together."""
        spread = self.pixels.std(axis=0, ddof=1) / math.sqrt(len(self.pixels))
        return np.asarray(np.hypot(*spread.T))


def scatter_discs(camera: OmniCamera, per_distance: int, seed: int = 7) -> list[Disc]:
    """Discs whose windows lie within the rim and do not overlap."""
    rng = np.random.default_rng(seed)
    low = max(2.0 * math.atan(camera.projection.t_min) + 0.04, math.radians(3.0))
    theta = rng.uniform(low, camera.rim_rad, _NUM_CANDIDATES)
    azimuth = rng.uniform(-math.pi, math.pi, _NUM_CANDIDATES)
    sine = np.sin(theta)
    units = np.stack((sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(theta)), axis=-1)
    distances = np.resize(DISTANCES_M, _NUM_CANDIDATES)
    pixels, valid = pixel_from_point(camera, distances[:, None] * units)
    radii = np.hypot(*(pixels - camera.centre_px).T)
    slopes = camera.radius_slope_px(np.tan(0.5 * theta))
    discs: list[Disc] = []
    counts = dict.fromkeys(DISTANCES_M, 0)
    for i in np.flatnonzero(valid):
        distance = float(distances[i])
        size = _DIAMETERS_PX[counts[distance] % len(_DIAMETERS_PX)]
        half = 0.5 * size / math.sqrt(slopes[i] * radii[i] / sine[i]) * distance
        column, row = np.floor(pixels[i] - 0.5 * WINDOW_PX).astype(int).tolist()
        disc = Disc(distance * units[i], half, (column, row), float(theta[i]))
        within = radii[i] < camera.rim_radius_px - 0.5 * size - 2.0
        is_free = within and all(_are_apart(disc, other) for other in discs)
        if is_free and counts[distance] < per_distance:
            counts[distance] += 1
            discs.append(disc)
    return discs


def _are_apart(one: Disc, other: Disc) -> bool:
    gaps = np.abs(np.subtract(one.corner, other.corner))
    return bool(gaps.max() >= WINDOW_PX)


def _centroid(light: Floats, disc: Disc) -> Floats:
    v, u = np.mgrid[:WINDOW_PX, :WINDOW_PX] + 0.5
    return np.array(((u * light).sum(), (v * light).sum())) / light.sum() + disc.corner


def draw_ours(camera: OmniCamera, discs: list[Disc]) -> Centroids:
    """Centroids in pictures of the trace renderer in linear light, window by window."""
    white = Material((1.0, 1.0, 1.0), unlit=True)
    items = tuple(
        Item(f"disc {i}", Ring(0.0, disc.radius_m, sectors=240), _facing(disc.centre), white)
        for i, disc in enumerate(discs)
    )
    world = World("discs", items)
    renderer = TraceRenderer(build_scene(world), world, threads=1)
    pixels, areas = np.zeros((_REPEATS, len(discs), 2)), np.zeros(len(discs))
    settings = RenderSettings(PerPixel(), samples=_GRID)
    for number, disc in enumerate(discs):
        for repeat in range(_REPEATS):
            # A window that begins elsewhere in the pixel has its samples elsewhere on the disc.
            shift = np.array((repeat, repeat * 3 % _REPEATS)) / (_REPEATS * _GRID)
            centre = np.asarray(camera.centre_px) - disc.corner + shift
            window = replace(camera, width_px=WINDOW_PX, height_px=WINDOW_PX,
                             centre_px=(float(centre[0]), float(centre[1])))  # fmt: skip
            plan = plan_from_settings(settings, window, kind=RendererKind.TRACE, reason="proof")
            view = renderer.prepare(window, plan)
            light = view.render_linear(CameraState(Pose.identity()))[..., 0].astype(np.float64)
            view.close()
            pixels[repeat, number] = _centroid(light, disc) - shift
            areas[number] += light.sum() / _REPEATS
    renderer.close()
    return Centroids(pixels, areas)


def _facing(centre: Floats) -> Pose:
    """Pose of a ring that faces the origin."""
    z = centre / np.linalg.norm(centre)
    x = np.cross(np.eye(3)[int(np.argmin(np.abs(z)))], z)
    x /= np.linalg.norm(x)
    return Pose(np.stack((x, np.cross(z, x), z), axis=-1), centre)


def draw_by_mitsuba(case: MirrorCase, discs: list[Disc], samples: int) -> Centroids:
    """Centroids in Mitsuba's pictures of the same windows."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    mi.set_log_level(mi.LogLevel.Error)
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 2},
        "mirror": _mitsuba_mirror(mi, case),
    }
    for number, disc in enumerate(discs):
        up = np.eye(3)[int(np.argmin(np.abs(disc.centre)))]
        pose = _look(mi, case, disc.centre, up)
        scene[f"disc{number}"] = {
            "type": "disk",
            "to_world": pose.scale(_UNITS_PER_M * disc.radius_m),
            "emitter": {"type": "area", "radiance": {"type": "rgb", "value": 1.0}},
        }
    loaded = mi.load_dict(scene)
    pixels, areas = np.zeros((_REPEATS, len(discs), 2)), np.zeros(len(discs))
    for number, disc in enumerate(discs):
        sensor = mi.load_dict(_mitsuba_camera(mi, case, disc))
        for seed in range(_REPEATS):
            image = mi.render(loaded, sensor=sensor, seed=1000 * number + seed, spp=samples)
            light = np.array(image, dtype=np.float64)[..., 0]
            pixels[seed, number] = _centroid(light, disc)
            areas[number] += light.sum() / _REPEATS
    return Centroids(pixels, areas)


def _mitsuba_camera(mi: Any, case: MirrorCase, disc: Disc) -> dict[str, Any]:
    camera, pinhole = case.camera, case.camera.mirror.pinhole_distance_m
    width = camera.width_px
    film = {
        "type": "hdrfilm", "width": width, "height": width, "rfilter": {"type": "box"},
        "crop_offset_x": disc.corner[0], "crop_offset_y": disc.corner[1],
        "crop_width": WINDOW_PX, "crop_height": WINDOW_PX,
        "pixel_format": "rgb", "component_format": "float32",
    }  # fmt: skip
    sensor = {"film": film, "sampler": {"type": "stratified"}, "near_clip": _NEAR_MM}
    if case.surface.is_telecentric:
        pose = _look(mi, case, np.array((0.0, 0.0, 0.1)), np.eye(3)[0])
        half = 0.5 * width / case.surface.focal_px * _UNITS_PER_M
        return sensor | {"type": "orthographic", "to_world": pose.scale([half, half, 1.0])}
    pose = _look(mi, case, np.array((0.0, 0.0, pinhole)), np.eye(3)[0])
    fov = 2.0 * math.degrees(math.atan(0.5 * width / case.surface.focal_px))
    return sensor | {"type": "perspective", "fov": fov, "to_world": pose}


def _look(mi: Any, case: MirrorCase, place: Floats, up: Floats) -> Any:
    """Mitsuba's pose at (3,) a place in the mirror frame that looks at the effective viewpoint."""
    middle = np.array((0.0, 0.0, _middle_m(case)))
    origin, target = _UNITS_PER_M * (place - middle), -_UNITS_PER_M * middle
    return mi.ScalarTransform4f().look_at(origin=list(origin), target=list(target), up=list(up))


def _middle_m(case: MirrorCase) -> float:
    """Height half-way between vertex and rim."""
    mirror = case.camera.mirror
    t = np.array((mirror.t_min, case.camera.rim_t))
    return float(mirror.surface_point(t)[1].mean())


def _mitsuba_mirror(mi: Any, case: MirrorCase) -> Any:
    steel = {"type": "conductor", "material": "none"}
    surface, mirror = case.surface, case.camera.mirror
    pinhole = 0.0 if surface.is_telecentric else mirror.pinhole_distance_m
    # Depth of the middle, from which heights are counted.
    pinhole -= _middle_m(case)
    if case.name == "spherical":
        r, depth, _, _ = surface.curve(np.array((0.5 * math.pi, 0.0)))
        return {"type": "sphere", "center": [0, 0, _UNITS_PER_M * (pinhole - depth[0])],
                "radius": _UNITS_PER_M * float(r[0]), "bsdf": steel}  # fmt: skip
    parameter = _rings(case)
    r, depth, dr, dd = surface.curve(parameter)
    azimuth = 2.0 * math.pi * np.arange(_SECTORS) / _SECTORS
    circle = np.stack((np.cos(azimuth), np.sin(azimuth)), axis=-1)

    def spread(across: Floats, along: Floats) -> Any:
        around = across[:, None, None] * circle
        height = np.broadcast_to(along[:, None, None], (*around.shape[:2], 1))
        return np.concatenate((around, height), axis=-1).astype(np.float32).ravel()

    length = np.hypot(dr, dd)
    ring, sector = np.meshgrid(np.arange(len(r) - 1), np.arange(_SECTORS), indexing="ij")
    a, b = ring * _SECTORS + sector, ring * _SECTORS + (sector + 1) % _SECTORS
    first = np.stack((a, a + _SECTORS, b), axis=-1).reshape(-1, 3)
    second = np.stack((b, a + _SECTORS, b + _SECTORS), axis=-1).reshape(-1, 3)
    faces = np.concatenate((first, second)).astype(np.uint32)
    properties = mi.Properties()
    properties["mesh_bsdf"] = mi.load_dict(steel)
    mesh = mi.Mesh("mirror", len(r) * _SECTORS, len(faces), has_vertex_normals=True,
                   props=properties)  # fmt: skip
    numbers = mi.traverse(mesh)
    numbers["vertex_positions"] = spread(_UNITS_PER_M * r, _UNITS_PER_M * (pinhole - depth))
    numbers["vertex_normals"] = spread(dd / length, dr / length)
    numbers["faces"] = faces.ravel()
    numbers.update()
    return mesh


def _rings(case: MirrorCase) -> Floats:
    """Parameters of the mesh's rings, at even image radii to a little beyond the rim."""
    fine = np.linspace(0.0, case.surface.last * (1.0 - 1e-9), 20_001)
    r, depth, out_r, out_d = reflect(case.surface, fine[1:])
    image = r if case.surface.is_telecentric else r / depth
    rim = np.searchsorted(np.arctan2(out_r, -out_d), case.camera.rim_rad)
    end = min(1.02 * image[rim], image[-1])
    return np.interp(np.linspace(1e-6 * end, end, _RINGS + 1), image, fine[1:])


def compare_discs(case: MirrorCase, *, per_distance: int, samples: int) -> Iterator[Finding]:
    """Compare both renderers' discs; the last finding is the scale of a camera 1e-4 too large."""
    discs = scatter_discs(case.camera, per_distance)
    theirs = draw_by_mitsuba(case, discs, samples)
    yield from _judge(case, discs, draw_ours(case.camera, discs), theirs)
    camera = replace(case.camera, scale_px=case.camera.scale_px * (1.0 + MUTATION))
    yield list(_judge(case, discs, draw_ours(camera, discs), theirs))[-1]


def _judge(
    case: MirrorCase, discs: list[Disc], ours: Centroids, theirs: Centroids
) -> Iterator[Finding]:
    authority = version_of("mitsuba")
    apart, areas = ours.mean - theirs.mean, theirs.areas
    theta = np.array([disc.theta_rad for disc in discs])
    distances = np.array([np.linalg.norm(disc.centre) for disc in discs])
    # A cone's image begins at the angle of its apex.
    hub_rad = 2.0 * math.atan(case.camera.projection.t_min) + HUB_RAD
    counted = (areas >= MIN_AREA_PX) & (theta >= hub_rad)
    rows = [(f" at {m:g} m", counted & (np.abs(distances - m) < 1e-9)) for m in DISTANCES_M]
    for name, chosen in (*rows, (_IN_HUB, theta < hub_rad)):
        if chosen.any():
            errors = [float(np.median(c.standard_errors[chosen])) for c in (theirs, ours)]
            error = f"Mitsuba {errors[0]:.4f}, ours {errors[1]:.4f}"
            bound = math.inf if name == _IN_HUB else BOUND_PX
            apart_px = np.hypot(*apart[chosen].T)
            yield summarize(case.name + name, authority, apart_px, bound, "px", error=error)
    # Radial scale: the least-squares factor from Mitsuba's positions about the centre to ours; a
    # shift by the inverse distance is Mitsuba's start off the surface.
    place = theirs.mean[counted] - case.camera.centre_px
    unit = place / np.linalg.norm(place, axis=1, keepdims=True)
    near = 1.0 / distances[counted]
    columns = np.stack((place.ravel(), (unit * near[:, None]).ravel()), axis=-1)
    fit, rest, _, _ = np.linalg.lstsq(columns, apart[counted].ravel(), rcond=None)
    variance = float(rest[0]) / (len(columns) - 2) * np.linalg.inv(columns.T @ columns)[0, 0]
    factor = abs(float(fit[0]))
    yield Finding(f"{case.name}, scale", authority, factor, factor, SCALE_BOUND, "",
                  len(place), f"{math.sqrt(variance):.1e}")  # fmt: skip
