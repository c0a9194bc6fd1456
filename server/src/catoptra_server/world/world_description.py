"""Description of a world: shapes with materials, landmarks, lights, start poses, tags, victims.

Frozen data; frame: world (SAE, z down, floor at z = 0). Colours are linear albedos in [0, 1], and
linear from sRGB by IEC 61966-2-1.

Objects are what labels count as one thing, with a name and a class. Items of one object name are
one object. A glTF file has an object for each of its nodes, named after both; its class is the
node's name without a trailing number, as modelling programs count copies (chair.001, chair_2).
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from catoptra_protocol.errors import DomainError, SourceLocation
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.elementary import cos, hypot, matmul, power, sin
from catoptra_protocol.optics.numerics import Floats, require_domain
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.usarsim.reports import StartPose

if TYPE_CHECKING:
    from catoptra_server.world.panorama import Panorama

Rgb = tuple[float, float, float]

Vector3 = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class World:
    """Whole world."""

    name: str
    items: tuple[Item, ...]
    landmarks: tuple[Landmark, ...] = ()
    lights: tuple[Light, ...] = ()
    starts: tuple[StartPose, ...] = ()
    background: Rgb = (0.0, 0.0, 0.0)
    """Linear radiance of directions without a surface; with a sky, its mean."""
    sky: Panorama | None = None
    """Radiance of these directions, where it differs between them."""
    landmark_albedos: dict[str, Rgb] = field(default_factory=dict)
    """Linear albedo of each colour name in the landmark file."""
    rfid_tags: tuple[RfidTag, ...] = ()
    victims: tuple[Victim, ...] = ()
    gps_origin: GpsOrigin | None = None
    ambient_occlusion: bool = False
    """Whether the server darkens hemisphere light where the static scene occludes it."""
    light_bake: bool = False
    """Whether light that surfaces reflect, and that of area lights and the sky through openings, is
    computed on the nodes of grids; then no hemisphere light shines through walls."""
    area_lights: tuple[RectangleLight, ...] = ()
    """Lights that only a bake has."""
    object_sky: HemisphereLight | None = None
    """Mean light on surfaces where light is baked; None: that of the lights."""
    probes: LightProbes | None = None
    """Light of dynamic objects, beside that of lamps and suns; None: the mean or the lights."""

    @property
    def light_groups(self) -> list[str]:
        """Names of the groups of lights, sorted."""
        lamps = (*self.lights, *self.area_lights)
        names = {one.group for one in lamps if not isinstance(one, HemisphereLight)}
        return sorted(names - {""})

    @property
    def background_range(self) -> tuple[Rgb, Rgb]:
        """Least and largest linear radiance of directions without a surface."""
        if self.sky is None:
            return self.background, self.background
        return self.sky.least, self.sky.largest


@dataclass(frozen=True, slots=True)
class Item:
    """Shape with a material and a pose."""

    name: str
    shape: Shape
    world_from_item: Pose
    material: Material | None
    """None: the mesh file's own materials."""
    casts_shadows: bool = True
    """False for surfaces that let light through, such as a ceiling under lamps."""
    unlit: bool | None = None
    """Whether a mesh file is shown at its albedo, whatever the lights; None: as file or material
    say."""
    where: SourceLocation | None = None
    """Line of the world's file, for errors of its mesh and texture; None for an item of no file."""
    object_name: str = ""
    """Object that the item is a part of; empty: an object of the item's own name."""
    class_name: str = ""
    """Class of the object, for labels; empty: the node's name, or the default."""
    scale: Vector3 = (1.0, 1.0, 1.0)
    """Factors of the shape along its axes, after its own scale; negative ones mirror."""


@dataclass(frozen=True, slots=True)
class Material:
    """Lambertian surface."""

    albedo: Rgb
    texture: Path | str | None = None
    """Image file, or name of a texture of `named_textures`, whose colours multiply the albedo."""
    unlit: bool = False
    """Show the albedo whatever the lights, for markers and luminous panels."""
    tile_m: float = 0.0
    """Side of a tile of the texture, before the item's scale; 0: by the shape or the mesh file."""
    emission: Rgb = (0.0, 0.0, 0.0)
    """Linear radiance of its own, added to reflected light; 1 is white at full scale."""
    gloss: SurfaceGloss | None = None
    """How it mirrors; None: matt."""


@dataclass(frozen=True, slots=True)
class SurfaceGloss:
    """Mirroring surface of a material, for the effect of this name."""

    reflectance: float
    """Fresnel's along the normal, F0, above 0: 0.04 of varnish and wet floors, 0.9 of silver."""
    roughness: float
    """From 0, a mirror, to 1, which mirrors a mean."""


@dataclass(frozen=True, slots=True)
class Box:
    """Box, centred on its pose."""

    size_m: tuple[float, float, float]
    """Full edge lengths."""


@dataclass(frozen=True, slots=True)
class Cylinder:
    """Upright cylinder with caps, centred on its pose."""

    radius_m: float
    height_m: float
    sectors: int = 48
    """Number of facets around the axis."""


@dataclass(frozen=True, slots=True)
class Rectangle:
    """Level rectangle that faces up (-z)."""

    size_m: tuple[float, float]
    texture_repeat: tuple[float, float] = (1.0, 1.0)
    """Repetitions of the texture along y and along x."""


@dataclass(frozen=True, slots=True)
class Ring:
    """Level annulus that faces up, such as the line of a centre circle."""

    inner_radius_m: float
    outer_radius_m: float
    sectors: int = 96
    """Number of facets around the centre."""


@dataclass(frozen=True, slots=True)
class SphereBand:
    """Band of a sphere between two angles from the lower pole (+z), lit from inside or outside."""

    radius_m: float
    from_rad: float
    to_rad: float
    sectors: int = 360
    rings: int = 1
    is_solid: bool = False
    """Whether the band is lit from outside."""


@dataclass(frozen=True, slots=True)
class MeshFile:
    """Mesh file (GLB, glTF, OBJ, PLY, STL, DAE)."""

    path: Path
    scale: float = 1.0
    """Metres a unit of the file."""
    up: str = ""
    """Upward axis of the file, x, y or z; empty: as its format or the file itself says."""
    has_optional_textures: bool = False
    """Whether surfaces are drawn without textures that are missing."""


@dataclass(frozen=True, slots=True, eq=False)
class Facets:
    """Triangles of a scenery, in the item's frame."""

    corners: Floats
    """(n, 3, 3) metres; counter-clockwise from outside."""
    uv: Floats
    """(n, 3, 2) texture coordinates."""
    normals: Floats
    """(n, 3, 3) unit normals at the corners, by which light is reflected."""


Primitive = Box | Cylinder | Rectangle | Ring | SphereBand | Facets
Shape = Primitive | MeshFile

# A millimetre from a point light of this intensity the irradiance still is a float32 number, and so
# is the sum of a hundred.
MAX_LIGHT = 1e30


@dataclass(frozen=True, slots=True)
class HemisphereLight:
    """Light from all directions: the irradiance varies from up to down with the normal."""

    up_irradiance: Rgb
    """Irradiance of an upward surface."""
    down_irradiance: Rgb
    """Irradiance of a downward surface."""
    sides: tuple[Rgb, Rgb, Rgb, Rgb] | None = None
    """Irradiance of surfaces that face x, -x, y and -y; None: half of up and down each."""

    def __post_init__(self) -> None:
        _check_light("hemisphere", self.up_irradiance, self.down_irradiance, *(self.sides or ()))

    @property
    def faces(self) -> Floats:
        """(6, 3) irradiance of surfaces that face x, -x, y, -y, down and up."""
        up, down = np.array(self.up_irradiance), np.array(self.down_irradiance)
        sides = [0.5 * (up + down)] * 4 if self.sides is None else self.sides
        return np.array([*sides, down, up])

    @property
    def largest(self) -> Floats:
        """(3,) bound of the irradiance of any surface."""
        one, other = self.faces[::2], self.faces[1::2]
        odd = np.sqrt(np.square(0.5 * (one - other)).sum(axis=0))
        largest: Floats = odd + 0.5 * (one + other).max(axis=0)
        return largest


@dataclass(frozen=True, slots=True, eq=False)
class LightProbes:
    """Baked light on a regular grid of places, for what moves: ambient cubes.

    Source: McTaggart 2004, "Half-Life 2 / Valve Source Shading"; between the six directions light
    is `shading.facet_irradiance`'s.
    """

    first: Floats
    """(3,) place of the first probe, world frame, metres."""
    step: Floats
    """(3,) metres between probes along each axis."""
    faces: Floats
    """(nx, ny, nz, 6, 3) irradiance as of `HemisphereLight.faces`."""

    def find_light(self, place: Floats) -> HemisphereLight:
        """Light at a (3,) place, between the eight probes about it; outside that of the border."""
        last = np.array(self.faces.shape[:3]) - 1
        position = np.clip((place - self.first) / self.step, 0.0, last)
        before = np.minimum(position.astype(np.intp), np.maximum(last - 1, 0))
        x, y, z = before
        cell = self.faces[x : x + 2, y : y + 2, z : z + 2].astype(np.float64)
        for rest in position - before:
            cell = cell[0] + rest * (cell[-1] - cell[0])
        right, left, front, back, down, up = map(tuple, cell.tolist())
        return HemisphereLight(up, down, (right, left, front, back))


@dataclass(frozen=True, slots=True)
class DirectionalLight:
    """Parallel light, such as the sun's."""

    direction: tuple[float, float, float]
    """Direction in which the light travels, unit, world frame."""
    irradiance: Rgb
    """Irradiance of a surface perpendicular to the direction."""
    group: str = ""
    """Lights whose brightness data sets vary together; empty: with all others."""

    def __post_init__(self) -> None:
        _check_light("directional", self.irradiance)


@dataclass(frozen=True, slots=True)
class PointLight:
    """Point source."""

    position_m: tuple[float, float, float]
    intensity: Rgb
    """Irradiance at one metre."""
    group: str = ""
    """As of a directional light."""

    def __post_init__(self) -> None:
        _check_light("point", self.intensity)


@dataclass(frozen=True, slots=True)
class RectangleLight:
    """Rectangle that shines evenly on one side, such as a lamp or a window; it is not seen."""

    position_m: tuple[float, float, float]
    """Its middle."""
    direction: tuple[float, float, float]
    """Normal of the side that shines, unit, world frame."""
    size_m: tuple[float, float]
    """Its side along the horizontal, or along x where it is level, and the other."""
    intensity: Rgb
    """Irradiance at one metre in front of a small one: radiance times area over pi."""
    group: str = ""
    """As of a directional light."""

    def __post_init__(self) -> None:
        _check_light("rectangle", self.intensity)


def _check_light(kind: str, *colours: Rgb) -> None:
    """Raise DomainError for a light that is negative, not a number, or above MAX_LIGHT."""
    for colour in colours:
        # NaN fails the comparison and so is rejected, too.
        if not all(0.0 <= value <= MAX_LIGHT for value in colour):
            raise DomainError(f"a {kind} light of {colour!r}: allowed is 0 to {MAX_LIGHT:g}")


Light = HemisphereLight | DirectionalLight | PointLight


@dataclass(frozen=True, slots=True)
class RfidTag:
    """Tag for RFID readers."""

    number: int
    position_m: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Victim:
    """Victim, or a part of one, for victim sensors."""

    name: str
    position_m: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class GpsOrigin:
    """Position of the world's origin on Earth; north and east are positive."""

    latitude_deg: float
    longitude_deg: float


_DEFAULT_CLASS = "object"
"""Class of an item whose file names none."""
ROBOT_CLASS = "robot"

_COPY_NUMBER = re.compile(r"[ ._-]*\d+$")


@dataclass(frozen=True, slots=True)
class SceneObject:
    """One thing in the static scene."""

    name: str
    class_name: str

    @classmethod
    def from_item(cls, item: Item, node: str = "") -> SceneObject:
        """Object that an item, or a node of its mesh file, is a part of."""
        name = item.object_name or item.name
        if not node:
            return cls(name, item.class_name or _DEFAULT_CLASS)
        class_name = item.class_name or _COPY_NUMBER.sub("", node) or _DEFAULT_CLASS
        return cls(f"{name}/{node}", class_name)


@dataclass(frozen=True, slots=True)
class Twist:
    """Velocity of a rigid frame, referred to the frame's origin.

    The holder of a twist names the frame, and the axes of both vectors.
    """

    linear_m_s: Vector3 = (0.0, 0.0, 0.0)
    """Velocity of the origin."""
    angular_rad_s: Vector3 = (0.0, 0.0, 0.0)
    """Angular velocity about axes through the origin."""

    def at_offset(self, offset_m: Floats) -> Twist:
        """Same motion, referred to another origin, (3,) metres from this one."""
        # Plain floats: composed for every frame, in a tenth of the time of arrays of three.
        vx, vy, vz = self.linear_m_s
        wx, wy, wz = self.angular_rad_s
        x, y, z = offset_m.tolist()
        linear = (vx + (wy * z - wz * y), vy + (wz * x - wx * z), vz + (wx * y - wy * x))
        return Twist(linear, self.angular_rad_s)

    def relative_to(self, other: Twist) -> Twist:
        """Motion relative to another frame, both referred to one origin."""
        (vx, vy, vz), (ux, uy, uz) = self.linear_m_s, other.linear_m_s
        (ax, ay, az), (bx, by, bz) = self.angular_rad_s, other.angular_rad_s
        return Twist((vx - ux, vy - uy, vz - uz), (ax - bx, ay - by, az - bz))

    def rotate(self, rotation: Floats) -> Twist:
        """Same motion in rotated axes, by a (3, 3) rotation."""
        linear = matmul(rotation, np.asarray(self.linear_m_s))
        return Twist(_vector3(linear), _vector3(matmul(rotation, np.asarray(self.angular_rad_s))))

    def integrate_pose(self, pose: Pose, time_s: float) -> Pose:
        """Pose after some seconds of this motion; both in the axes of the pose's parent."""
        return integrate_poses([(pose, self)], time_s)[0]

    @property
    def speed_m_s(self) -> float:
        """Speed of the origin."""
        return hypot(*self.linear_m_s)


AT_REST = Twist()


def _vector3(values: Floats) -> Vector3:
    x, y, z = values.tolist()
    return x, y, z


def integrate_poses(motions: Sequence[tuple[Pose, Twist]], time_s: float) -> list[Pose]:
    """Poses after some seconds of a motion each, in any number at once.

    Args:
        motions: Pose and motion of each body, in the axes of the pose's parent.
        time_s: Time of the motions, of either sign.
    """
    poses = [pose for pose, _ in motions]
    # A pose at rest stays the same object: a standing robot's frames are then the same bytes.
    moving = [(index, twist) for index, (_, twist) in enumerate(motions) if twist != AT_REST]
    if not moving:
        return poses
    linear = np.array([twist.linear_m_s for _, twist in moving]) * time_s
    angular = np.array([twist.angular_rad_s for _, twist in moving]) * time_s
    # Rotation and translation separately rather than along a screw: the origin keeps its velocity
    # in the world, which is the meaning of a twist here.
    rotations = np.array([poses[index].rotation for index, _ in moving])
    translations = np.array([poses[index].translation for index, _ in moving])
    moved = zip(
        matmul(_rotations_from_vectors(angular), rotations), translations + linear, strict=True
    )
    for (index, _), (rotation, translation) in zip(moving, moved, strict=True):
        poses[index] = Pose(rotation, translation)
    return poses


# Of each axis k the matrix of rows e_i x e_k.
_SKEW_OF_AXES = np.cross(np.eye(3), np.eye(3)[:, None]).reshape(3, 9)


def _rotations_from_vectors(vectors: Floats) -> Floats:
    """(n, 3, 3) rotations about (n, 3) vectors by their lengths in radians: Rodrigues' formula."""
    # Products of matrices throughout: a body's pose has the same bits alone and among others.
    angle = np.sqrt(matmul(vectors[:, None, :], vectors[:, :, None]))
    axes = vectors / np.where(angle == 0.0, 1.0, angle)[..., 0]
    skew = matmul(axes, _SKEW_OF_AXES).reshape(-1, 3, 3)
    rotations: Floats = np.eye(3) + sin(angle) * skew + matmul((1.0 - cos(angle)) * skew, skew)
    return rotations


def linear_from_srgb(encoded: Floats) -> Floats:
    """Linear light of encoded values, both in [0, 1]."""
    encoded = np.asarray(encoded, dtype=np.float64)
    return np.where(encoded <= 0.04045, encoded / 12.92, power((encoded + 0.055) / 1.055, 2.4))


@np.errstate(under="ignore")  # an underflow is black
def srgb_from_linear(linear: Floats) -> Floats:
    """Encoded values of linear light; light outside [0, 1] is clipped, as by a sensor.

    Raises:
        DomainError: An element is not a number; the text names the element.
    """
    require_domain(~np.isnan(linear), linear, "light is a number")
    # NaN passes a clip silently and would become an arbitrary grey: rejected above.
    linear = np.clip(np.asarray(linear, dtype=np.float64), 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * power(linear, 1 / 2.4) - 0.055)
