"""Description of a world: shapes with materials, landmarks, lights, start poses, tags, victims.

Frozen data; frame: world (SAE, z down, floor at z = 0). Colours are linear albedos in [0, 1].
"""

from __future__ import annotations

from dataclasses import field
from pathlib import Path

from catoptra_protocol.errors import DomainError, SourceLocation
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass

Rgb = tuple[float, float, float]

# A millimetre from a point light of this intensity the irradiance still is a float32 number, and so
# is the sum of a hundred.
MAX_LIGHT = 1e30


@dataclass(frozen=True, slots=True)
class Material:
    """Lambertian surface."""

    albedo: Rgb
    texture: Path | None = None
    """Image file whose colours multiply the albedo."""
    unlit: bool = False
    """Show the albedo whatever the lights, for markers and luminous panels."""


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
    """Band of a sphere between two angles from the lower pole (+z), visible from inside."""

    radius_m: float
    from_rad: float
    to_rad: float
    sectors: int = 360
    rings: int = 1


@dataclass(frozen=True, slots=True)
class MeshFile:
    """Mesh file (GLB, glTF, OBJ, PLY, STL, DAE)."""

    path: Path
    scale: float = 1.0
    """Metres a unit of the file."""
    up: str = "z"
    """Upward axis of the file, y or z."""


Primitive = Box | Cylinder | Rectangle | Ring | SphereBand
Shape = Primitive | MeshFile


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
    """Class of the object, for labels; empty: `SceneObject`'s default, or that of a file's node."""


@dataclass(frozen=True, slots=True)
class HemisphereLight:
    """Light from all directions: the irradiance varies from up to down with the normal."""

    up_irradiance: Rgb
    """Irradiance of an upward surface."""
    down_irradiance: Rgb
    """Irradiance of a downward surface."""

    def __post_init__(self) -> None:
        _check_light("hemisphere", self.up_irradiance, self.down_irradiance)


@dataclass(frozen=True, slots=True)
class DirectionalLight:
    """Parallel light, such as the sun's."""

    direction: tuple[float, float, float]
    """Direction in which the light travels, unit, world frame."""
    irradiance: Rgb
    """Irradiance of a surface perpendicular to the direction."""

    def __post_init__(self) -> None:
        _check_light("directional", self.irradiance)


@dataclass(frozen=True, slots=True)
class PointLight:
    """Point source."""

    position_m: tuple[float, float, float]
    intensity: Rgb
    """Irradiance at one metre."""

    def __post_init__(self) -> None:
        _check_light("point", self.intensity)


def _check_light(kind: str, *colours: Rgb) -> None:
    """Raise DomainError for a light that is negative, not a number, or above MAX_LIGHT."""
    for colour in colours:
        # NaN fails the comparison and so is rejected, too.
        if not all(0.0 <= value <= MAX_LIGHT for value in colour):
            raise DomainError(f"a {kind} light of {colour!r}: allowed is 0 to {MAX_LIGHT:g}")


Light = HemisphereLight | DirectionalLight | PointLight


@dataclass(frozen=True, slots=True)
class StartPlace:
    """Named start pose of a robot: INIT {Start name}, GETSTARTPOSES."""

    name: str
    location_m: tuple[float, float, float]
    rotation_rad: tuple[float, float, float]


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


@dataclass(frozen=True, slots=True)
class World:
    """Whole world."""

    name: str
    items: tuple[Item, ...]
    landmarks: tuple[Landmark, ...] = ()
    lights: tuple[Light, ...] = ()
    starts: tuple[StartPlace, ...] = ()
    background: Rgb = (0.0, 0.0, 0.0)
    """Linear radiance of directions without a surface."""
    landmark_albedos: dict[str, Rgb] = field(default_factory=dict)
    """Linear albedo of each colour name in the landmark file."""
    rfid_tags: tuple[RfidTag, ...] = ()
    victims: tuple[Victim, ...] = ()
    gps_origin: GpsOrigin | None = None
    ambient_occlusion: bool = False
    """Whether the server darkens hemisphere light where the static scene occludes it."""
