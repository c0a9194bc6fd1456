"""Ids and ranges of pixels, against a caster that shares no code with the product.

Boxes and rectangles are numbers here, not triangles: a ray meets a box by its slabs and a rectangle
by its plane, in float64; rays are those of the publications (`mirrors.py`, `lenses.py`). The trace
renderer's rays are float32. Where rays a ten-thousandth of a pixel to the left, right, above or
below the centre meet different objects, an edge runs through the centre: either id is right there,
and no other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from catoptra_protocol.optics.lenses import EquidistantLens
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.radial_camera import Picture
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.labels import LabelledImage
from catoptra_server.frames.labels.label_renderer import LabelRenderer
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Box, Item, Material, Rectangle, World
from outside.findings import Finding, bisect, summarize
from outside.mirrors import MirrorCase, mirror_cases, reflect

# float32 rays of an image of 360 px: 6e-8 of 180 px, and some roundings.
EDGE_PX = 1e-4
BOUND_RELATIVE = 1e-4
_NUM_BOXES, _NUM_RECTANGLES = 28, 8
_AUTHORITY = "float64 caster of boxes and rectangles, in this measurement"

Ids = npt.NDArray[np.int64]
# (n, 2) pixels: (n, 3) origins and directions in the mirror frame, unit.
Rays = Callable[[Floats], tuple[Floats, Floats]]


def make_world(seed: int = 5) -> World:
    """Boxes and rectangles between 0.25 and 4 m around the origin."""
    rng = np.random.default_rng(seed)
    white, items = Material((1.0, 1.0, 1.0)), []
    for number in range(_NUM_BOXES + _NUM_RECTANGLES):
        direction = rng.normal(size=3)
        distance = rng.uniform(0.3, 4.0)
        place = distance * direction / np.linalg.norm(direction)
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn *= np.sign(np.linalg.det(turn))
        size = distance * rng.uniform(0.1, 0.5, 3)
        is_box = number < _NUM_BOXES
        shape = Box((size[0], size[1], size[2])) if is_box else Rectangle((size[0], size[1]))
        items.append(Item(f"thing {number}", shape, Pose(turn, place), white))
    return World("things", tuple(items))


def cast(world: World, origins: Floats, directions: Floats) -> tuple[Ids, Floats]:
    """Numbers of the things that (n, 3) rays meet first, 0 for none, and their ranges."""
    ids, ranges = np.zeros(len(origins), dtype=np.int64), np.full(len(origins), math.inf)
    for number, item in enumerate(world.items, 1):
        turn, place = item.world_from_item.rotation, item.world_from_item.translation
        local, along = (origins - place) @ turn, directions @ turn
        size = np.array((*item.shape.size_m, 0.0)[:3])  # type: ignore[union-attr]
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.sort(
                np.stack(((-0.5 * size - local) / along, (0.5 * size - local) / along)), 0
            )
        enter, leave = ends[0].max(axis=-1), ends[1].min(axis=-1)
        # A ray that begins inside meets the box where it leaves.
        found = np.where(enter > 0.0, enter, leave)
        nearer = (enter <= leave) & (found > 0.0) & (found < ranges)
        ids[nearer], ranges[nearer] = number, found[nearer]
    return ids, ranges


def mirror_rays(case: MirrorCase) -> Rays:
    """Rays of pixels by the mirror's publication."""
    surface, camera = case.surface, case.camera

    def rays(pixels: Floats) -> tuple[Floats, Floats]:
        offset = pixels - camera.centre_px
        radius = np.hypot(*offset.T)
        parameter = bisect(surface.image_radius_px, radius, surface.last * (1.0 - 1e-9))
        r, depth, out_r, out_d = reflect(surface, parameter)
        unit = -offset[:, ::-1] / radius[:, None]
        origins = np.column_stack((r[:, None] * unit, case.pinhole_m - depth))
        directions = np.column_stack((out_r[:, None] * unit, -out_d))
        # Rays of a mirror with a viewpoint begin there.
        return (origins * 0.0 if camera.is_central else origins), directions

    return rays


def lens_rays(camera: OmniCamera) -> Rays:
    """Rays of an equidistant fish-eye: the angle is the radius over the focal length."""

    def rays(pixels: Floats) -> tuple[Floats, Floats]:
        right, down = (pixels - camera.centre_px).T / camera.scale_px
        theta = np.hypot(right, down)
        sine = np.sin(theta) / theta
        directions = np.stack((-sine * down, sine * right, np.cos(theta)), axis=-1)
        return np.zeros_like(directions), directions

    return rays


@dataclass(frozen=True, slots=True)
class LabelCase:
    """A camera, and its rays by the publication."""

    name: str
    camera: OmniCamera
    rays: Rays


def label_cases() -> list[LabelCase]:
    """Cameras with one viewpoint, without, and a lens."""
    eye = OmniCamera(EquidistantLens(), 360, 360, (180.3, 179.6), 90.0, math.radians(110.0),
                     picture=Picture.FLIPPED)  # fmt: skip
    mirrors = [case for case in mirror_cases() if case.name in ("hyperbolic", "spherical")]
    cases = [LabelCase(case.name, case.camera, mirror_rays(case)) for case in mirrors]
    return [*cases, LabelCase("equidistant", eye, lens_rays(eye))]


def compare_labels(case: LabelCase, camera: OmniCamera | None = None) -> Iterator[Finding]:
    """Compare labels by a case's camera, or by a mutant, with the caster's."""
    world = make_world()
    scene = build_scene(world)
    pose = Pose.from_rpy((0.02, -0.03, 0.01), (0.3, -0.2, 0.7))
    image = LabelledImage(camera or case.camera, CameraState(pose))
    renderer = TraceRenderer(scene, world, threads=1)
    labels = LabelRenderer(renderer, scene)
    found = labels.render(image, ("ids", "range", "valid")).channels
    labels.close()
    renderer.close()
    rows, columns = np.nonzero(found["valid"])
    centres = np.stack((columns + 0.5, rows + 0.5), axis=-1)
    hits = []
    for step in EDGE_PX * np.array(((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1))):
        origins, directions = case.rays(centres + step)
        place = origins @ pose.rotation.T + pose.translation
        hits.append(cast(world, place, directions @ pose.rotation.T))
    ids, ranges = np.stack([hit[0] for hit in hits]), hits[0][1]
    ours, our_ranges = found["ids"][rows, columns], found["range"][rows, columns]
    wrong = ~(ids == ours).any(axis=0)
    at_edge = (ids != ids[0]).any(axis=0)
    total, note = float(wrong.sum()), f"centres on an edge: {int(at_edge.sum())}"
    yield Finding(f"{case.name}: ids", _AUTHORITY, total, total, 0.0, "wrong", len(wrong), "", note)
    same = np.isfinite(ranges) & ~at_edge & ~wrong
    relative = np.abs(our_ranges[same] / ranges[same] - 1.0)
    yield summarize(f"{case.name}: ranges", _AUTHORITY, relative, BOUND_RELATIVE, "of the range",
                    note="float32 of ours")  # fmt: skip
