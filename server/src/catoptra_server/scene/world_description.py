"""What a world file describes: shapes with materials, landmarks, lights, places to start.

Frozen data, frame: world (SAE, z down, floor at z = 0). Colours are linear-light albedos in [0, 1].
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from catoptra_protocol.errors import DomainError
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.transforms import Pose

Rgb = tuple[float, float, float]

# A millimetre from such a lamp light still is a float32 number, and so is the sum of a hundred.
MAX_LIGHT = 1e30


@dataclass(frozen=True, slots=True)
class Material:
    """A Lambertian surface. `texture` is an image file that multiplies the albedo.

    unlit: shown at its albedo whatever the lights, for markers and luminous panels.
    """

    albedo: Rgb
    texture: Path | None = None
    unlit: bool = False


@dataclass(frozen=True, slots=True)
class Box:
    """A box of full edge lengths `size_m`, centred on its placement."""

    size_m: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Cylinder:
    """An upright cylinder with caps, centred on its placement, of `sectors` facets."""

    radius_m: float
    height_m: float
    sectors: int = 48


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A level rectangle that faces up (-z), textured once over its whole area."""

    size_m: tuple[float, float]
    texture_repeat: tuple[float, float] = (1.0, 1.0)


@dataclass(frozen=True, slots=True)
class Ring:
    """A level ring (annulus) that faces up, such as a centre circle's line."""

    inner_radius_m: float
    outer_radius_m: float
    sectors: int = 96


@dataclass(frozen=True, slots=True)
class SphereBand:
    """The part of a sphere between two angles from its lower pole (+z), seen from inside."""

    radius_m: float
    from_rad: float
    to_rad: float
    sectors: int = 360
    rings: int = 1


@dataclass(frozen=True, slots=True)
class MeshFile:
    """A mesh file (GLB, glTF, OBJ, PLY, STL, DAE), scaled, and turned if its up axis is y or z."""

    path: Path
    scale: float = 1.0
    up: str = "z"


Shape = Box | Cylinder | Rectangle | Ring | SphereBand | MeshFile


@dataclass(frozen=True, slots=True)
class Item:
    """A shape of one material at a place. `material` None: the mesh file's own materials.

    casts_shadows: false for what lets light through, such as a ceiling under lamps.
    """

    name: str
    shape: Shape
    world_from_item: Pose
    material: Material | None
    casts_shadows: bool = True


@dataclass(frozen=True, slots=True)
class HemisphereLight:
    """Light from everywhere: irradiance on a surface that faces up, and on one that faces down."""

    up_irradiance: Rgb
    down_irradiance: Rgb

    def __post_init__(self) -> None:
        _check_light("hemisphere", self.up_irradiance, self.down_irradiance)


@dataclass(frozen=True, slots=True)
class DirectionalLight:
    """Parallel light travelling along `direction` (unit, world frame)."""

    direction: tuple[float, float, float]
    irradiance: Rgb

    def __post_init__(self) -> None:
        _check_light("directional", self.irradiance)


@dataclass(frozen=True, slots=True)
class PointLight:
    """A point source; `intensity` is the irradiance at one metre."""

    position_m: tuple[float, float, float]
    intensity: Rgb

    def __post_init__(self) -> None:
        _check_light("point", self.intensity)


def _check_light(kind: str, *colours: Rgb) -> None:
    """Raise DomainError if a light is negative, no number, or brighter than numbers allow."""
    for colour in colours:
        if not all(0.0 <= value <= MAX_LIGHT for value in colour):
            raise DomainError(f"a {kind} light of {colour!r}: from 0 to {MAX_LIGHT:g} can be shown")


Light = HemisphereLight | DirectionalLight | PointLight


@dataclass(frozen=True, slots=True)
class StartPlace:
    """A named place where a robot may be spawned: INIT {Start name}, GETSTARTPOSES."""

    name: str
    location_m: tuple[float, float, float]
    rotation_rad: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class RfidTag:
    """A tag that RFID readers find by its number."""

    number: int
    position_m: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Victim:
    """A victim, or a part of one, that victim sensors find by its name."""

    name: str
    position_m: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class GpsOrigin:
    """Where on Earth the world's origin is, in degrees; north and east are positive."""

    latitude_deg: float
    longitude_deg: float


@dataclass(frozen=True, slots=True)
class World:
    """A whole world. `background` is the linear radiance where no surface is hit."""

    name: str
    items: tuple[Item, ...]
    landmarks: tuple[Landmark, ...] = ()
    lights: tuple[Light, ...] = ()
    starts: tuple[StartPlace, ...] = ()
    background: Rgb = (0.0, 0.0, 0.0)
    landmark_albedos: dict[str, Rgb] = field(default_factory=dict)
    rfid_tags: tuple[RfidTag, ...] = ()
    victims: tuple[Victim, ...] = ()
    gps_origin: GpsOrigin | None = None
