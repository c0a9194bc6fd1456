"""Ground truth of an image: what the rays of its pixels meet, without any error of the picture.

Rays go through the centres of the pixels by the exact camera model, whatever renderer, plan or
mirror mesh draws the picture; nothing is interpolated. Nothing is prepared before the first
request.

Here are the subjects of labels: an image, the rays of the pixels, and the objects of the world. The
image decides the objects in view, the rows of a rolling shutter and a displaced capture camera.
Of a displaced one each pixel has the ray of the point that its light came from (`Misalignment`);
under a rolling shutter each ray has the time of its row. Numbers, classes and boxes of objects
follow from the world and the order of spawning.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from itertools import pairwise
from typing import TYPE_CHECKING, cast

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError
from catoptra_protocol.labels import LabelledObject
from catoptra_protocol.optics.camera_rays import ray_from_pixel, rays_from_pixel_grid
from catoptra_protocol.optics.elementary import arctan2, matmul
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import ImageEffect
from catoptra_server.render.trace.ray_table import (
    BLOCK_RAYS,
    TILE_PX,
    RayTable,
    build_ray_table,
    lens_ray_table,
)
from catoptra_server.render.trace.trace_engine import (
    MovingExposure,
    TracedExposure,
    assemble_grid,
    camera_states,
)
from catoptra_server.world.objects import CameraState, DynamicObject
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import ROBOT_CLASS, SceneObject

if TYPE_CHECKING:
    from catoptra_server.effects.medium.misalignment import Misalignment


LabelCamera = OmniCamera | PerspectiveCamera


@dataclass(frozen=True, slots=True)
class RaySource:
    """Everything that the rays of an image depend on, but for the poses."""

    camera: LabelCamera
    misalignment: Misalignment | None = None
    """Displacement of the capture camera; None for an aligned one."""
    exposure_s: float = 0.0
    """Exposure time of a row; of no effect without a readout."""
    readout_s: float = 0.0
    """Readout time; 0 for a global shutter."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelledImage:
    """An image to label: everything that labels depend on."""

    camera: LabelCamera
    """Exact model of the camera."""
    camera_state: CameraState
    """State with all objects that the picture shows, and its shutter."""
    image_effects: tuple[ImageEffect, ...] = ()
    """Image effects that the picture has."""
    samples: int = 1
    """Samples along a pixel's side."""

    @property
    def ray_source(self) -> RaySource:
        """Everything that the rays depend on, but for the poses."""
        displaced = (one for one in self.image_effects if one.name == "Misalignment")
        misalignment = cast("Misalignment | None", next(displaced, None))
        shutter = self.camera_state.shutter
        if shutter is None or shutter.readout_s == 0.0:
            return RaySource(self.camera, misalignment)
        return RaySource(self.camera, misalignment, shutter.exposure_s, shutter.readout_s)


def build_label_rays(source: RaySource, samples: int) -> RayTable:
    """Rays of an image.

    Args:
        source: Camera and effects.
        samples: Samples along a pixel's side; of 1 the pixels' centres.
    """
    table = _build_table(source, samples)
    return table if source.readout_s == 0.0 else replace(table, times=_row_times(source, table))


def label_exposure(camera_state: CameraState) -> TracedExposure:
    """The exposure as its labels see it: sharp, at its middle or at each row's time."""
    # Neither light nor air has labels.
    plain = replace(camera_state, has_shadows=False, has_gloss=False, fog=None)
    shutter = plain.shutter
    if shutter is None or shutter.readout_s == 0.0:
        return replace(plain, shutter=None)
    return MovingExposure(camera_states(plain))


def find_valid_pixels(table: RayTable) -> Bools:
    """(h, w) whether a pixel's centre has a ray, of a table of one sample a pixel."""
    bits = np.unpackbits(table.valid[..., None].view(np.uint8), axis=-1, bitorder="little")
    grid = assemble_grid(table, bits[..., None].astype(np.float32), fill=np.float32(0.0))
    return np.asarray(grid[..., 0] > 0.0)


_Numbers = npt.NDArray[np.uint16]
# Values of 16 bits, some of them for robots.
_MAX_OBJECTS = 64000
_MAX_NUMBER = 65535
# Behind it 1024 objects of exposures have theirs.
_FIRST_MOVING = 64512
# Headings that a box may have: of the object's largest walls.
_MAX_HEADINGS = 16
# A round thing has an upright box that is smaller by some percent, along no axis of its own.
_MUCH_SMALLER = 0.9


class SceneLabels:
    """Numbers of the objects and classes of one world.

    Objects of the static scene have the numbers from 1 in the order of the world file, robots those
    after them in the order in which they were spawned. Classes have the numbers from 1 in the order
    of their names, the same for every robot in the world.

    Of fixed classes objects have fixed numbers as well: of the scene by their names, those of an
    exposure from 64 512 on.
    """

    def __init__(
        self,
        scene: SceneMesh,
        class_numbers: Mapping[str, int] | None = None,
        others: tuple[str, ...] = (),
    ) -> None:
        """Number the objects of a scene.

        Args:
            scene: The scene.
            class_numbers: Fixed numbers of all classes; None: by the scene.
            others: Classes whose objects no scene has, numbered behind them.

        Raises:
            DomainError: The world has more objects than numbers, or a class has none.
        """
        if len(scene.objects) > _MAX_OBJECTS:
            raise DomainError(
                f"this world has {len(scene.objects)} objects, and labels number at most "
                f"{_MAX_OBJECTS}: give items that belong together one Name="
            )
        self._scene = scene
        self._first_moving = len(scene.objects) + 1
        names = sorted({one.class_name for one in scene.objects} | {ROBOT_CLASS})
        names += sorted({*others} - {*names})
        if class_numbers is None:
            class_numbers = {name: number for number, name in enumerate(names, 1)}
            numbers = np.arange(1, len(scene.objects) + 1)
        else:
            numbers = np.array(_number_by_names(scene.objects), dtype=np.intp)
            self._first_moving = _FIRST_MOVING
        if missing := [name for name in names if name not in class_numbers]:
            raise DomainError(f"classes without a number: {', '.join(missing)}")
        self.classes = tuple(names)
        """Name of each class."""
        self._class_numbers = class_numbers
        self._numbers = numbers
        # The last one is of a scene without triangles.
        self.triangle_numbers: _Numbers = np.append(numbers, 0)[scene.object_index].astype(
            np.uint16
        )
        """(n,) number of each triangle's object."""

    def find_class_table(self, objects: tuple[DynamicObject, ...]) -> _Numbers:
        """(65536,) number of the class of each object's number, in an exposure of objects."""
        others = [one for one in objects if one.class_name != ROBOT_CLASS]
        table = self.class_table.copy() if others else self.class_table
        for one in others:
            table[self.number_of(one)] = self._class_numbers[one.class_name]
        return table

    @cached_property
    def class_table(self) -> _Numbers:
        """The same without an exposure's own classes; robots' behind the scene's."""
        table = np.full(_MAX_NUMBER + 1, self._class_numbers[ROBOT_CLASS], dtype=np.uint16)
        table[self._numbers] = [self._class_numbers[one.class_name] for one in self._scene.objects]
        table[0] = 0
        return table

    def number_of(self, placed: DynamicObject) -> int:
        """Number of a robot."""
        first = self._first_moving
        # After more robots than there are numbers the first ones are used again.
        return first + max(placed.number - 1, 0) % (_MAX_NUMBER + 1 - first)

    def describe(self, objects: tuple[DynamicObject, ...]) -> tuple[LabelledObject, ...]:
        """All objects of the world and of an exposure, by ascending number."""
        rows = zip(self._numbers.tolist(), self._scene.objects, self._extents, strict=True)
        static = [
            self._label(at, one.name, one.class_name, box)
            for at, one, box in sorted(rows, key=lambda row: row[0])
        ]
        robots = {self.number_of(placed): placed for placed in objects}
        return (
            *static,
            *(
                self._label(number, one.name, one.class_name, _extent_of(one))
                for number, one in sorted(robots.items(), key=lambda row: row[0])
            ),
        )

    def _label(self, number: int, name: str, class_name: str, extent: _Extent) -> LabelledObject:
        return LabelledObject(
            number,
            name,
            class_name,
            self._class_numbers[class_name],
            extent.world_from_box,
            extent.half_size_m,
        )

    @cached_property
    def _extents(self) -> tuple[_Extent, ...]:
        """Boxes around the objects of the static scene."""
        scene = self._scene
        order = np.argsort(scene.object_index, kind="stable")
        bounds = np.searchsorted(
            scene.object_index[order], np.arange(len(scene.objects) + 1)
        ).tolist()
        return tuple(_enclose(scene, order[begin:end]) for begin, end in pairwise(bounds))


def _number_by_names(objects: Sequence[SceneObject]) -> list[int]:
    """Number of each object by its name alone, but where two names meet: one world in 65 000 for
    each pair; then the later one takes the next free number."""
    taken: dict[int, None] = {}
    for one in objects:
        word = int.from_bytes(hashlib.sha256(one.name.encode()).digest()[:8], "little")
        number = 1 + word % (_FIRST_MOVING - 1)
        while number in taken:
            number = 1 + number % (_FIRST_MOVING - 1)
        taken[number] = None
    return [*taken]


def _build_table(source: RaySource, samples: int) -> RayTable:
    camera = source.camera
    if isinstance(camera, PerspectiveCamera):
        return lens_ray_table(camera, samples)
    look_up: Callable[[Floats, Floats], tuple[Floats | None, Floats, Bools]]
    if source.misalignment is None:
        look_up = partial(rays_from_pixel_grid, camera)
    else:
        look_up = partial(_misaligned_rays, camera, source.misalignment)
    return build_ray_table(camera, samples, look_up)


def _misaligned_rays(
    camera: OmniCamera, misalignment: Misalignment, u: Floats, v: Floats
) -> tuple[Floats | None, Floats, Bools]:
    """Rays of a grid of a displaced camera: of the points that the pixels look up."""
    # Loaded with the misalignment itself.
    from catoptra_server.effects.medium.misalignment import lookup_maps

    lookup = lookup_maps(misalignment, camera)[0]
    # Offsets vary by hundredths of a pixel from one pixel to the next: samples have their pixel's.
    # Tiles of the last row and column may reach beyond the image.
    rows = np.minimum(v.astype(np.intp), camera.height_px - 1)
    columns = np.minimum(u.astype(np.intp), camera.width_px - 1)
    at = lookup[rows[:, None], columns]
    points = np.stack(np.meshgrid(u, v), axis=-1) + at[..., :2]
    origins, directions, valid = ray_from_pixel(camera, points)
    return None if camera.is_central else origins, directions, valid & (at[..., 2] > 0.0)


def _row_times(source: RaySource, table: RayTable) -> npt.NDArray[np.float32]:
    """(t, samples^2, 16) times of rays within the whole exposure, 0 to 1, by their rows."""
    samples = table.samples
    block = np.arange(samples * samples) // samples
    lane = np.arange(BLOCK_RAYS) // TILE_PX
    row_in_tile = (block[:, None] * TILE_PX + lane) // samples
    row = (table.tiles // table.num_tile_columns * TILE_PX)[:, None, None] + row_in_tile
    total_s = source.exposure_s + source.readout_s
    fraction = (row + 0.5) / table.height_px - 0.5
    return np.asarray(0.5 + source.readout_s / total_s * fraction, dtype=np.float32)


@dataclass(frozen=True, slots=True, eq=False)
class _Extent:
    """Box around an object of the static scene."""

    world_from_box: Pose
    half_size_m: Floats


def _extent_of(placed: DynamicObject) -> _Extent:
    """Box of a robot, along its own axes."""
    pose = placed.world_from_object
    return _Extent(Pose(pose.rotation, placed.centre), placed.mesh.half_size_m)


def _enclose(scene: SceneMesh, triangles: npt.NDArray[np.intp]) -> _Extent:
    """Smallest box around triangles, along the axes of their items; an upright one by the headings
    of their walls where that is much smaller, as of a file with a turned mesh."""
    corners = scene.corners[triangles].reshape(-1, 3)
    if not len(corners):
        return _Extent(Pose.identity(), np.zeros(3))
    items = np.unique(scene.item_index[triangles])[:_MAX_HEADINGS]
    axes = [np.eye(3)] if scene.item_rotations is None else [*scene.item_rotations[items]]
    turns = [Pose.from_rpy((0.0, 0.0, 0.0), (0.0, 0.0, one)) for one in _headings(scene, triangles)]
    own, upright = (
        min((_box_along(corners, one) for one in rotations), key=_area)
        for rotations in (axes, [turn.rotation for turn in turns])
    )
    return upright if _area(upright) < _MUCH_SMALLER * _area(own) else own


def _area(box: _Extent) -> float:
    """A quarter of a box's surface, which also compares flat ones."""
    a, b, c = box.half_size_m.tolist()
    return float(a * b + b * c + c * a)


def _headings(scene: SceneMesh, triangles: npt.NDArray[np.intp]) -> list[float]:
    """Headings modulo 90 degrees of the largest upright triangles; 0 among them."""
    normals, corners = scene.normals[triangles], scene.corners[triangles]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=-1
    )
    area = np.where(np.abs(normals[:, 2]) < 0.5, area, 0.0)
    largest = np.argsort(-area, kind="stable")[:_MAX_HEADINGS]
    walls = largest[area[largest] > 0.0]
    azimuth = arctan2(normals[walls, 1], normals[walls, 0])
    # Rounded to a microradian, so that the walls of one box count once.
    return sorted({0.0, *np.round(np.mod(azimuth, 0.5 * math.pi), 6).tolist()})


def _box_along(corners: Floats, rotation: Floats) -> _Extent:
    """Box around (n, 3) points along the axes of a rotation."""
    turned = matmul(corners, rotation)
    low, high = turned.min(axis=0), turned.max(axis=0)
    centre = matmul(rotation, 0.5 * (low + high))
    return _Extent(Pose(rotation, centre), 0.5 * (high - low))
