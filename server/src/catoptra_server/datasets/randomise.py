"""What varies from sample to sample beside pose, brightness and effects: `[Catoptra.Randomise]`.

    Textures, TextureFolder, TextureShare, Colours, Gloss, Roughness, GlossShare, Keep    looks
    Lamps, LampIntensity, LampTint, LampHeight, LampDistance, Sun, SunElevation           light
    Distractors, DistractorSize, Objects=(Thing=,Class=,Count=), Robots=(Robot=,Count=), Distance
    MountShift, MountTurn, Calibration                                                    camera

Every number is drawn by (seed, sample, object, purpose): a key more, or an object more, changes no
other number. What stands or drives is drawn for a sequence, all else for a sample. Looks are of
whole objects, and are painted onto the committed scene: a renderer of 50 000 triangles takes 150 ms
to make and 8 ms to repaint (`tests/measurements/dataset_samples.py`). Things and robots are
dynamic objects; shapes of distractors are drawn once for a recipe, so that each mesh is committed
once. Baked light stays that of the world's own colours.

Where two things want one place, the later one in the order robots, objects, distractors looks for
another. The robot of the camera minds none of them.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from catoptra_protocol.calibration.uncertainty import draw_camera
from catoptra_protocol.errors import CatoptraError
from catoptra_protocol.optics.elementary import cos, hypot, matmul, sin
from catoptra_protocol.optics.numerics import Bools, Floats
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.datasets.recipe import (
    DISTRACTOR_CLASS,
    FreeThing,
    Randomisation,
    Recipe,
    ValueRange,
    read_range,
    read_words,
)
from catoptra_server.render.trace.ray_caster import SceneRayCaster
from catoptra_server.runtime.random_sources import RandomSource
from catoptra_server.world.named_textures import NAMED_TEXTURES
from catoptra_server.world.objects import ObjectMesh, build_object_mesh
from catoptra_server.world.scene_mesh import SceneMesh, build_scene
from catoptra_server.world.scenery import furniture, outdoors
from catoptra_server.world.scenery.things import Scenery, Thing
from catoptra_server.world.shapes import project_tiles
from catoptra_server.world.textures import TextureReader, TextureSampling
from catoptra_server.world.world_description import (
    Box,
    Cylinder,
    DirectionalLight,
    Item,
    Material,
    PointLight,
    SphereBand,
    World,
)

SECTION = "Catoptra.Randomise"
# Each lamp costs a shadow ray for each pixel; each thing is an object of the picture's rays.
_MAX_LAMPS, _MAX_DISTRACTORS, _MAX_THINGS, _MAX_ROBOTS = 32, 256, 32, 16
# Numbers of objects, from which labels count: behind the camera's robot, 1.
FIRST_ROBOT, _FIRST_THING, _FIRST_DISTRACTOR = 2, 64, 128
_NUM_SHAPES = 48
_IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".bmp")
_TILED = tuple(name for name, one in NAMED_TEXTURES.items() if one.tile_m)
_ONE = ValueRange(1.0, 1.0)
# Side of a tile of an image file.
_FILE_TILE_M = 1.0
_MAKERS: dict[str, Callable[[np.random.Generator], Thing]] = {
    "backpack": furniture.backpack,
    "ball": furniture.ball,
    "barrel": outdoors.barrel,
    "bin": furniture.bin_,
    "box": furniture.cardboard_box,
    "chair": furniture.office_chair,
    "cone": lambda random: outdoors.cone(),
    "dummy": outdoors.dummy,
    "dustbin": outdoors.dustbin,
    "pallet": outdoors.pallet,
    "plant": furniture.plant,
    "rock": outdoors.rock,
    "sofa": furniture.sofa,
    "stool": furniture.stool,
    "toolbox": furniture.toolbox,
    "trolley": furniture.trolley,
    "tyres": outdoors.tyres,
}
"""Things that objects may be."""


def read_randomisation(file: IniFile) -> Randomisation | None:
    """What varies, by a recipe; None without the section.

    Raises:
        ConfigError: A key is wrong, or a folder has no image.
    """
    section = file.get_section(SECTION)
    if not file.has_section(SECTION):
        return None

    def find_range(key: str, default: ValueRange, largest: float, least: float = 0.0) -> ValueRange:
        return read_range(section, key, default, min_value=least, max_value=largest)

    def find_optional(key: str, largest: float) -> ValueRange | None:
        return find_range(key, _ONE, largest) if section.has_key(key) else None

    def find_share(key: str) -> float:
        return section.get_float(key, 0.5, min_value=0.0, max_value=1.0)

    return Randomisation(
        where=section.where,
        textures=(
            *read_words(section, "Textures", _TILED, ()),
            *_read_folder(section, file.path.parent),
        ),
        texture_share=find_share("TextureShare"),
        colours=find_optional("Colours", 10.0),
        gloss=find_optional("Gloss", 1.0),
        gloss_share=find_share("GlossShare"),
        roughness=find_range("Roughness", ValueRange(0.0, 0.5), 1.0),
        kept_classes=tuple(filter(None, map(str.strip, section.get_str("Keep", "").split(",")))),
        lamps=find_optional("Lamps", _MAX_LAMPS),
        lamp_intensity=find_range("LampIntensity", ValueRange(0.5, 3.0), 1e6),
        lamp_tint=find_range("LampTint", ValueRange(0.6, 1.0), 1.0),
        lamp_height_m=find_range("LampHeight", ValueRange(1.0, 2.5), 1000.0),
        lamp_distance_m=find_range("LampDistance", ValueRange(0.5, 4.0), 1000.0),
        sun=find_optional("Sun", 1e6),
        sun_elevation_rad=find_range("SunElevation", ValueRange(0.3, 1.3), 0.5 * math.pi, 0.01),
        distractors=find_optional("Distractors", _MAX_DISTRACTORS),
        distractor_size_m=find_range("DistractorSize", ValueRange(0.1, 0.5), 100.0, 0.01),
        distance_m=find_range("Distance", ValueRange(0.5, 4.0), 1000.0),
        things=tuple(_read_things(section)),
        robots=tuple(_read_robots(section, file.path.parent)),
        mount_shift_m=section.get_float("MountShift", 0.0, min_value=0.0, max_value=1.0),
        mount_turn_rad=section.get_float("MountTurn", 0.0, min_value=0.0, max_value=0.5),
        calibration=section.get_float("Calibration", 0.0, min_value=0.0, max_value=10.0),
    )


def _read_folder(section: SectionReader, folder: Path) -> list[Path]:
    """Image files of a folder, by name."""
    text = section.get_str("TextureFolder", "")
    if not text:
        return []
    path = folder / text
    files = [one for one in sorted(path.glob("*")) if one.suffix.lower() in _IMAGE_SUFFIXES]
    if not files:
        expected = f"a folder with images ({', '.join(_IMAGE_SUFFIXES)}); {path} has none"
        raise section.make_error("TextureFolder", expected=expected)
    return files


def _read_things(section: SectionReader) -> Iterator[FreeThing]:
    total = 0
    for struct in section.get_structs("Objects", example="(Thing=chair,Count=2)"):
        name = struct.get_choice("Thing", tuple(_MAKERS))
        count = read_range(struct, "Count", _ONE, min_value=0.0, max_value=_MAX_THINGS)
        total += round(count.high)
        yield FreeThing(name, struct.get_wire_name("Class", name), count, struct.where)
    if total > _MAX_THINGS:
        raise section.make_error("Objects", expected=f"at most {_MAX_THINGS} in all, not {total}")


def _read_robots(section: SectionReader, folder: Path) -> Iterator[Path]:
    total = 0
    for struct in section.get_structs("Robots", example='(Robot="p2dx",Count=1)'):
        path = struct.get_path("Robot", folder, bundled="robots")
        count = struct.get_int("Count", 1, min_value=1, max_value=_MAX_ROBOTS)
        total += count
        yield from (path,) * count
    if total > _MAX_ROBOTS:
        raise section.make_error("Robots", expected=f"at most {_MAX_ROBOTS} in all, not {total}")


def random_source(recipe: Recipe, purpose: str) -> RandomSource:
    """Random numbers of the samples, or sequences, for one purpose."""
    return RandomSource.from_names(recipe.seed, "dataset", purpose)


def _draw_count(recipe: Recipe, purpose: str, values: ValueRange | None, index: int) -> int:
    """Whole number of a range, both ends included."""
    if values is None:
        return 0
    low, high = round(values.low), round(values.high)
    return low + int(random_source(recipe, purpose).generator(index).integers(high - low + 1))


class ScenePainter:
    """Looks of the objects of one world."""

    def __init__(self, recipe: Recipe, scene: SceneMesh) -> None:
        """Read the textures.

        Raises:
            ConfigError: A texture cannot be read, or a class is unknown.
        """
        varied = recipe.randomisation
        assert varied is not None, "something varies"
        self._recipe, self._varied = recipe, varied
        with TextureReader() as reader:
            added = [
                reader.load(one) if isinstance(one, Path) else reader.load_by_name(one)
                for one in varied.textures
            ]
            for texture in added:
                reader.wait(texture)
        self._first = len(scene.textures)
        is_shown = ~scene.unlit
        for flags in (scene.blended, None if scene.coverage is None else _has_holes(scene)):
            is_shown = is_shown if flags is None else is_shown & ~flags
        kept = [one.class_name in varied.kept_classes for one in scene.objects]
        self._rows = np.flatnonzero(is_shown & ~np.array([*kept, True])[scene.object_index])
        """Triangles that are painted."""
        self._owner = scene.object_index[self._rows]
        words = [hashlib.sha256(one.name.encode()).digest()[:8] for one in scene.objects]
        self._words = np.frombuffer(b"".join(words), dtype="<u8")
        tiles = [
            NAMED_TEXTURES[o].tile_m if isinstance(o, str) else _FILE_TILE_M
            for o in varied.textures
        ]
        self._tiles_m = np.array(tiles)
        self._uv = project_tiles(scene.corners[self._rows], 1.0) if added else None
        no_gloss = scene.gloss is None and varied.gloss is not None
        self.scene = replace(
            scene,
            textures=(*scene.textures, *added),
            samplings=(*scene.samplings, *[TextureSampling()] * len(added)),
            # Placements of one file look different: each triangle has a row of its own.
            uv=np.array(scene.corner_uv) if added else scene.uv,
            uv_rows=None if added else scene.uv_rows,
            gloss=np.zeros((len(scene), 2)) if no_gloss else scene.gloss,
        )
        """The scene as it is committed, in its own looks."""

    def paint(self, index: int) -> SceneMesh:
        """The scene of a sample."""
        varied, scene, rows, owner = self._varied, self.scene, self._rows, self._owner
        if not varied.textures and varied.colours is None and varied.gloss is None:
            return scene
        looks: dict[str, Any] = {}
        albedo = scene.albedo.copy()
        corners = None if scene.corner_albedo is None else scene.corner_albedo.copy()
        if varied.textures:
            share, which = self._draw("texture", index, 2).T
            which = (which * len(varied.textures)).astype(np.intp)
            mine = np.flatnonzero((share < varied.texture_share)[owner])
            number = which[owner[mine]]
            texture_index, uv = scene.texture_index.copy(), scene.uv.copy()
            texture_index[rows[mine]] = self._first + number
            assert self._uv is not None, "there are textures"
            uv[rows[mine]] = self._uv[mine] / self._tiles_m[number, None, None]
            albedo[rows[mine]] = 1.0
            if corners is not None:
                corners[rows[mine]] = 1.0
            looks |= {"texture_index": texture_index, "uv": uv}
        if varied.colours is not None:
            factors = _spread(varied.colours, self._draw("colour", index, 3))[owner]
            albedo[rows] = np.minimum(albedo[rows] * factors, 1.0)
            if corners is not None:
                corners[rows] = np.minimum(corners[rows] * factors[:, None], 1.0)
        if varied.gloss is not None and scene.gloss is not None:
            share, reflectance, roughness = self._draw("gloss", index, 3).T
            pair = (_spread(varied.gloss, reflectance), _spread(varied.roughness, roughness))
            mine = np.flatnonzero((share < varied.gloss_share)[owner])
            gloss = scene.gloss.copy()
            gloss[rows[mine]] = np.stack(pair, axis=-1)[owner[mine]]
            looks["gloss"] = gloss
        return scene.repaint(albedo=albedo, corner_albedo=corners, **looks)

    def _draw(self, purpose: str, index: int, count: int) -> Floats:
        """(n, count) uniform numbers of all objects, by their names and nothing else."""
        keys = random_source(self._recipe, f"look {purpose}").generator(index)
        state = self._words[:, None] ^ keys.integers(2**64, size=count, dtype=np.uint64)
        # SplitMix64 (Steele, Lea, Flood 2014) of all at once: a generator each takes 20 us.
        for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
            state = (state ^ (state >> np.uint64(shift))) * np.uint64(factor)
        state ^= state >> np.uint64(31)
        return (state >> np.uint64(11)).astype(np.float64) * 2.0**-53


def _has_holes(scene: SceneMesh) -> Bools:
    assert scene.coverage is not None, "some triangles have holes"
    return np.asarray(np.isfinite(scene.coverage).any(axis=-1))


def _spread(values: ValueRange, uniform: Floats) -> Floats:
    return values.low + (values.high - values.low) * uniform


def draw_lights(
    recipe: Recipe, index: int, viewpoint: Floats, floor_z_m: float, caster: SceneRayCaster
) -> tuple[DirectionalLight | None, tuple[PointLight, ...]]:
    """Sun, None for the world's, and lamps of a sample, which see the camera.

    Args:
        recipe: The recipe.
        index: Number of the sample.
        viewpoint: (3,) of the camera, metres, world frame.
        floor_z_m: Floor of the robot, downwards.
        caster: Of the scene.
    """
    varied = recipe.randomisation
    if varied is None:
        return None, ()
    sun = None
    if varied.sun is not None:
        draw = random_source(recipe, "sun").generator(index)
        irradiance, elevation = varied.sun.draw(draw), varied.sun_elevation_rad.draw(draw)
        level, azimuth = float(cos(elevation)), 2.0 * math.pi * float(draw.random())
        way = (level * cos(azimuth), level * sin(azimuth), sin(elevation))
        sun = DirectionalLight(way, (irradiance,) * 3)
    lamps = []
    for number in range(_draw_count(recipe, "lamps", varied.lamps, index)):
        draw = random_source(recipe, f"lamp {number}").generator(index)
        azimuth, distance_m = (
            2.0 * math.pi * float(draw.random()),
            varied.lamp_distance_m.draw(draw),
        )
        height_m, intensity = varied.lamp_height_m.draw(draw), varied.lamp_intensity.draw(draw)
        red, green, blue = (intensity * varied.lamp_tint.draw(draw) for _ in range(3))
        x, y, _ = viewpoint.tolist()
        at = np.array(
            (x + distance_m * cos(azimuth), y + distance_m * sin(azimuth), floor_z_m - height_m)
        )
        ray = at - viewpoint
        length_m = max(hypot(*ray.tolist()), 1e-9)
        free_m = float(caster.distances(viewpoint[None], ray[None] / length_m)[0])
        # Before the wall that it would be behind.
        at = viewpoint + min(1.0, 0.9 * free_m / length_m) * ray
        lamps.append(PointLight((at[0].item(), at[1].item(), at[2].item()), (red, green, blue)))
    return sun, tuple(lamps)


def draw_mount(recipe: Recipe, index: int, robot_from_camera: Pose) -> Pose:
    """Mount of the camera in a sample."""
    varied = recipe.randomisation
    if varied is None or not (varied.mount_shift_m or varied.mount_turn_rad):
        return robot_from_camera
    parts = 2.0 * random_source(recipe, "mount").generator(index).random(6) - 1.0
    turn = Pose.from_rpy((0.0, 0.0, 0.0), varied.mount_turn_rad * parts[3:])
    return Pose(
        matmul(turn.rotation, robot_from_camera.rotation),
        robot_from_camera.translation + varied.mount_shift_m * parts[:3],
    )


def draw_calibration(recipe: Recipe, index: int, camera: OmniCamera, file: Path) -> OmniCamera:
    """Camera of a sample, of those that a calibration file's covariance allows.

    Raises:
        ConfigError: The file states no covariance.
        DomainError: The parameters drawn are of no camera.
    """
    varied = recipe.randomisation
    assert varied is not None, "something varies"
    source = random_source(recipe, "calibration")

    def draw(count: int) -> Floats:
        return varied.calibration * np.array(source.normal_variates(index, count))

    return draw_camera(camera, file.read_text(encoding="utf-8"), str(file), draw)


class PlacedThing(NamedTuple):
    """A thing in free space."""

    name: str
    class_name: str
    number: int
    mesh: ObjectMesh
    world_from_thing: Pose


class FreeSpace:
    """Places near the way of a robot where nothing is."""

    def __init__(
        self, caster: SceneRayCaster, way: Floats, own_radius_m: float, distance_m: ValueRange
    ) -> None:
        """Take nothing yet.

        Args:
            caster: Of the scene.
            way: (n, 3) places of the camera's robot.
            own_radius_m: Of that robot.
            distance_m: From the way to places.
        """
        self._caster, self._way, self._distance_m = caster, way, distance_m
        self._own_radius_m = own_radius_m
        self._taken = np.zeros((0, 3))

    def take(self, random: np.random.Generator, radius_m: float, height_m: float) -> Floats | None:
        """(3,) place on the floor for an upright cylinder, which nobody gets again; None: none.

        In sight of the way, on a level floor, with nothing above and around.
        """
        for _ in range(_NUM_BATCHES):
            places = self._draw(random)
            for place in self._find_free(places, radius_m, height_m)[:1]:
                self._taken = np.vstack((self._taken, (*place[:2], radius_m)))
                return np.asarray(place)
        return None

    def _draw(self, random: np.random.Generator) -> Floats:
        """(n, 3) places in sight of the way, at its height."""
        along, turn, far = random.random((3, _BATCH))
        begin = self._way[(along * len(self._way)).astype(np.intp)]
        distance = _spread(self._distance_m, far)
        angle = 2.0 * math.pi * turn
        ways = np.stack((cos(angle), sin(angle), np.zeros(_BATCH)), axis=-1)
        is_seen = self._caster.distances(begin, ways) > distance
        return np.asarray((begin + ways * distance[:, None])[is_seen])

    def _find_free(self, places: Floats, radius_m: float, height_m: float) -> Floats:
        """Those of (n, 3) places with room, on their floor."""
        gap = np.linalg.norm(places[:, None, :2] - self._way[None, :, :2], axis=-1).min(axis=1)
        apart = np.linalg.norm(places[:, None, :2] - self._taken[None, :, :2], axis=-1)
        is_free = gap > radius_m + self._own_radius_m + _MARGIN_M
        is_free &= (apart > radius_m + self._taken[:, 2] + _MARGIN_M).all(axis=1)
        places = places[is_free]
        down, normals = self._caster.closest_hits(places, np.broadcast_to(_DOWN, places.shape))
        has_floor = np.isfinite(down) & (normals[:, 2] < -0.9)
        places = places[has_floor] + down[has_floor, None] * _DOWN
        return places[self._has_room(places, radius_m, height_m)]

    def _has_room(self, floor: Floats, radius_m: float, height_m: float) -> Bools:
        """(n,) whether nothing is in cylinders on (n, 3) places."""
        top_m = height_m + _MARGIN_M
        rim = np.vstack((np.zeros(3), 0.6 * radius_m * _RING[::2], radius_m * _RING))
        above = floor[:, None] + rim - top_m * _DOWN
        down, _ = self._cast(above, np.broadcast_to(_DOWN, above.shape))
        has_room: Bools = np.asarray((np.abs(down - top_m) < _LEVEL_M).all(axis=1))
        for height in (min(0.1, 0.5 * height_m), 0.8 * height_m):
            ways = np.broadcast_to(_RING, (len(floor), *_RING.shape))
            starts = np.broadcast_to((floor - height * _DOWN)[:, None], ways.shape)
            reach, normals = self._cast(starts, ways)
            # From inside a solid rays meet backs.
            is_back = (normals * ways).sum(axis=-1) > 0.0
            has_room &= ((reach > radius_m + _MARGIN_M) & ~is_back).all(axis=1)
        return has_room

    def _cast(self, starts: Floats, ways: Floats) -> tuple[Floats, Floats]:
        distances, normals = self._caster.closest_hits(
            np.ascontiguousarray(starts.reshape(-1, 3)), np.ascontiguousarray(ways.reshape(-1, 3))
        )
        return distances.reshape(starts.shape[:-1]), normals.reshape(starts.shape)


_DOWN = np.array((0.0, 0.0, 1.0))
_BATCH, _NUM_BATCHES = 24, 8
_MARGIN_M, _LEVEL_M = 0.05, 0.02
_ANGLES: Floats = np.arange(16.0) * (math.pi / 8.0)
_RING = np.stack((cos(_ANGLES), sin(_ANGLES), np.zeros(16)), axis=-1)


class ThingMaker:
    """Meshes of things and distractors of a recipe, each made once for a process."""

    def __init__(self, recipe: Recipe) -> None:
        self._recipe = recipe
        self._shape, self._thing = cache(self._make_shape), cache(self._make_thing)

    def place_all(self, space: FreeSpace, sequence: int, world: str) -> list[PlacedThing]:
        """Things and distractors of a sequence.

        Raises:
            CatoptraError: One that must be there finds no place.
        """
        varied, placed, number = self._recipe.randomisation, [], _FIRST_THING
        assert varied is not None, "something varies"
        for one in varied.things:
            for count in range(_draw_count(self._recipe, one.name, one.count, sequence)):
                name = f"{one.name}.{count + 1}"
                mesh = self._thing(one.name, count)
                found = self._place(space, name, one.class_name, number + count, mesh, sequence)
                if found is not None:
                    placed.append(found)
                elif count < one.count.low:
                    raise CatoptraError(
                        f"{one.where}: no free space for {name} in world {world}; let Count begin "
                        "lower, as (Min=0,Max=2), or give another Distance"
                    )
            number += round(one.count.high)
        least = 0 if varied.distractors is None else round(varied.distractors.low)
        for count in range(_draw_count(self._recipe, "distractors", varied.distractors, sequence)):
            name = f"{DISTRACTOR_CLASS}.{count + 1}"
            kinds = random_source(self._recipe, f"{name} kind").generator(sequence)
            mesh = self._shape(int(kinds.integers(_NUM_SHAPES)))
            number = _FIRST_DISTRACTOR + count
            found = self._place(space, name, DISTRACTOR_CLASS, number, mesh, sequence)
            if found is not None:
                placed.append(found)
            elif count < least:
                raise CatoptraError(
                    f"{varied.where}: Distractors: no free space for {name} in world {world}; "
                    "lower Min or DistractorSize, or give another Distance"
                )
        return placed

    def _place(
        self,
        space: FreeSpace,
        name: str,
        class_name: str,
        number: int,
        mesh: ObjectMesh,
        sequence: int,
    ) -> PlacedThing | None:
        random = random_source(self._recipe, f"{name} place").generator(sequence)
        yaw = 2.0 * math.pi * float(random.random())
        reach = np.abs(mesh.centre[:2]) + mesh.half_size_m[:2]
        height_m = float(mesh.half_size_m[2] - mesh.centre[2])
        place = space.take(random, float(hypot(*reach.tolist())), height_m)
        if place is None:
            return None
        pose = Pose.from_rpy(place, (0.0, 0.0, yaw))
        return PlacedThing(name, class_name, number, mesh, pose)

    def _make_thing(self, name: str, count: int) -> ObjectMesh:
        scenery = Scenery((), 0)
        random = random_source(self._recipe, f"{name}.{count + 1} thing").generator(0)
        scenery.place(name, _MAKERS[name](random), 0.0, 0.0)
        return _build_mesh(scenery.items)

    def _make_shape(self, kind: int) -> ObjectMesh:
        """One of the shapes of distractors: a box, a cylinder or a ball."""
        varied = self._recipe.randomisation
        assert varied is not None, "something varies"
        random = random_source(self._recipe, f"{DISTRACTOR_CLASS} shape").generator(kind)
        x, y, z = (varied.distractor_size_m.draw(random) for _ in range(3))
        red, green, blue, share, which = random.random(5).tolist()
        texture, tile_m = None, 0.0
        if varied.textures and share < varied.texture_share:
            texture = varied.textures[int(which * len(varied.textures))]
            tile_m = 0.5
        material = Material((red, green, blue), texture, tile_m=tile_m)
        shape, height_m = (
            (Box((x, y, z)), z),
            (Cylinder(0.5 * x, z, 24), z),
            (SphereBand(0.5 * x, 0.0, math.pi, sectors=24, rings=12, is_solid=True), x),
        )[kind % 3]
        pose = Pose.from_rpy((0.0, 0.0, -0.5 * height_m))
        return _build_mesh([Item(DISTRACTOR_CLASS, shape, pose, material)])


def _build_mesh(items: Sequence[Item]) -> ObjectMesh:
    return build_object_mesh((), body=build_scene(World("thing", tuple(items))))
