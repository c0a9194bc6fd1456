"""The interface of the trace renderer's two engines: the native kernel and the NumPy reference.

An engine holds a scene; `prepare` gives it the rays of a camera. Both shade by the same model
(`world/shading.py`) and agree to one grey level wherever all samples of a pixel meet one surface.
Here are the protocols, what a frame is requested and returned as, and the layout of ray tables as
images.

Labels are found along rays through the pixels' centres, by numbers of objects and classes. Where
the picture's rays and times are those of the labels, both are found in one pass: all channels then
add 140 % to a clean picture, alone they take 211 % (`tests/measurements/labels.py`). Optical flow
projects the points of one exposure into the camera of another.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import field
from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.elementary import hypot
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects import EffectChange, ImageEffect, Threshold
from catoptra_server.render.image_changer import ImageChanger
from catoptra_server.render.renderer import Image, LinearImage, RenderedImage, advance
from catoptra_server.render.trace.ray_table import TILE_PX, Element, Float32s, RayTable
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import SceneMesh
from catoptra_server.world.world_description import World

PixelLabels = dict[str, npt.NDArray[Any]]
"""(h, w) or (h, w, k) channels of labels by name."""
LabelNumbers = npt.NDArray[np.uint16]
STATIC_SCENE = 0
"""Object number of the static scene; dynamic objects follow in the order of the camera state."""
NOTHING = -1
"""Object and triangle number of a ray without a hit."""
NO_MOTION = -1
"""Index of the motion of an object at rest."""


class TraceEngine(Protocol):
    """A scene, ready to be traced."""

    @property
    def description(self) -> str:
        """Engine, instruction set and threads, for logs."""

    @property
    def image_changer(self) -> ImageChanger:
        """Applies image effects to the engine's images, for any camera."""

    def prepare(self, rays: RayTable) -> TracedRays:
        """Prepare the rays of a camera."""

    def repaint(self, scene: SceneMesh, world: World) -> None:
        """Show the same triangles in other looks and light; views stay."""

    def close(self) -> None:
        """Free the scene."""


class TracedRays(Protocol):
    """The rays of one camera, prepared by an engine."""

    @property
    def memory_bytes(self) -> int:
        """Size of the rays and of the engine's tables."""

    def render(self, exposure: TracedExposure, request: TraceRequest) -> TracedFrame:
        """A frame and all other outputs that are wanted."""

    def render_srgb(self, exposure: TracedExposure) -> Image:
        """(h, w, 3) sRGB, read-only; black off the mirror."""

    def render_linear(self, exposure: TracedExposure) -> LinearImage:
        """(h, w, 3) linear light; zero off the mirror. Light beyond white is kept."""

    def find_hits(self, exposure: TracedExposure) -> RayHits:
        """First hit of each ray."""

    def label_pixels(self, exposure: TracedExposure, request: LabelRequest) -> PixelLabels:
        """Labels without an image; the agreement is of these rays."""

    def close(self) -> None:
        """Free what belongs to these rays."""


@dataclass(frozen=True, slots=True, eq=False)
class TraceRequest:
    """Outputs of a frame."""

    is_linear: bool = False
    """Linear light instead of sRGB."""
    has_ranges: bool = False
    """Whether ranges are wanted, too."""
    thresholds: Mapping[str, Threshold] = field(default_factory=dict)
    """Change that nobody misses, by effect: see `View.render`."""
    labels: LabelRequest | None = None
    """Labels that are wanted, too, of an exposure at rest; an engine may leave out labels."""


@dataclass(frozen=True, slots=True, eq=False)
class TracedFrame:
    """A frame with all that was requested of it."""

    image: npt.NDArray[Any]  # of the type that the request names
    """(h, w, 3) sRGB, read-only; or linear light, not clipped."""
    changes: Mapping[str, EffectChange] = field(default_factory=dict)
    """Change by effect: see `RenderedImage.changes`."""
    range_m: Float32s | None = None
    """(h, w) ranges of the pixels, metres; inf where nothing is met."""
    stage_ms: Mapping[str, float] = field(default_factory=dict)
    """Milliseconds of parts of the frame that are stages of their own."""
    labels: PixelLabels | None = None
    """Labels, if they were wanted and the engine finds them beside an image."""


@dataclass(frozen=True, slots=True, eq=False)
class RayHits:
    """What each ray of an image meets first, in the layout of the ray table.

    Invalid rays meet nothing.
    """

    range_m: Float32s
    """(t, samples^2, 16) distances along the rays, metres; inf where nothing is met."""
    triangle: npt.NDArray[np.int32]
    """(t, samples^2, 16) index of the triangle in the scene's or the object's mesh, or NOTHING."""
    object: npt.NDArray[np.int32]
    """(t, samples^2, 16) STATIC_SCENE, 1 + index of a dynamic object, or NOTHING."""


@runtime_checkable
class FlowRays(Protocol):
    """Rays of an engine that finds optical flow itself."""

    def find_flow(self, other: TracedExposure, tables: FlowTables) -> Float32s:
        """(h, w, 2) displacement of points to their places in another exposure; nan: not seen."""


@runtime_checkable
class LabellingView(Protocol):
    """View whose rays find labels while a picture is drawn."""

    def render_with_labels(
        self,
        camera_state: CameraState,
        effects: tuple[ImageEffect, ...],
        thresholds: Mapping[str, Threshold],
        labels: LabelRequest | None,
    ) -> tuple[RenderedImage, PixelLabels | None]:
        """Render one exposure at rest, as `View.render`, and find labels where the engine can."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelRequest:
    """Labels that are wanted of an image."""

    channels: frozenset[str]
    """Names of the channels."""
    tables: LabelTables
    centres: RayTable
    """Rays of the pixels' centres: one sample a pixel."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelTables:
    """Numbers of objects and classes."""

    triangle_numbers: LabelNumbers
    """(n,) number of the object of each triangle of the static scene."""
    object_numbers: LabelNumbers
    """(o,) number of each dynamic object, in the order of the exposure."""
    class_table: LabelNumbers
    """(65536,) number of the class of each object's number."""


@dataclass(frozen=True, slots=True, eq=False)
class FlowTables:
    """Points of an image, and a camera as tables by the angle from its axis."""

    points: Float32s
    """(h, w, 3) points that the pixels show, world frame; nan where they show none."""
    ids: npt.NDArray[np.uint16]
    """(h, w) numbers of the objects that these belong to."""
    motions: Mapping[int, Pose]
    """Motion of each moving object by number, world there from world here."""
    gone: Collection[int]
    """Numbers of objects that are missing in the other exposure."""
    places: Floats
    """(n,) evenly spaced places of the camera's domain: t / (1 + t), t = tan(angle / 2)."""
    radius_px: Floats
    """(n,) image radii."""
    axes: Floats
    """(2, 2) unit displacements in the image, columns, of the azimuths of x and of y."""
    centre_px: tuple[float, float]
    origin_r: Floats | None = None
    """(n,) distances of the rays' origins from the axis, metres; None: all at the viewpoint."""
    origin_z: Floats | None = None
    """(n,) their positions along the axis."""


@dataclass(frozen=True, slots=True, eq=False)
class MovingExposure:
    """Poses of camera and objects during an exposure, for rays with times.

    Between two states the entries of rotations and translations are interpolated linearly: no exact
    rotation. A state every few degrees is exact enough.
    """

    states: tuple[CameraState, ...]
    """At least two, evenly spaced over the times 0 to 1, with the same objects in the same order.
    The first one decides on shadows."""

    def __post_init__(self) -> None:
        if len(self.states) < 2:
            raise DomainError(f"{len(self.states)} states: a moving exposure needs at least two")
        meshes = [tuple(placed.mesh for placed in state.objects) for state in self.states]
        if any(later != meshes[0] for later in meshes):
            raise DomainError("the states of a moving exposure need the same objects in one order")


TracedExposure = CameraState | MovingExposure
"""One state, or several for rays with times; without times the first state counts."""


def first_state(exposure: TracedExposure) -> CameraState:
    """State that decides on all that does not move."""
    return exposure.states[0] if isinstance(exposure, MovingExposure) else exposure


# Between two rotations 2 degrees apart interpolated entries are a rotation's to 2e-4.
_MAX_TURN_RAD = 0.035
# A robot that spins for the longest exposure of a minute: coarser, but bounded.
_MAX_TURNS = 256


def camera_states(exposure: TracedExposure) -> tuple[CameraState, ...]:
    """Sharp states of an exposure, evenly spaced from its begin to its end.

    Of one state with a shutter two, or as many as turns take for poses between two of them to be
    interpolated entry by entry; without a shutter the state itself.
    """
    if isinstance(exposure, MovingExposure):
        return exposure.states
    shutter = exposure.shutter
    if shutter is None:
        return (exposure,)
    total_s = shutter.exposure_s + shutter.readout_s
    twists = (exposure.twist, *(placed.twist for placed in exposure.objects))
    turn_rad = total_s * max(hypot(*twist.angular_rad_s) for twist in twists)
    steps = min(1 + int(turn_rad / _MAX_TURN_RAD), _MAX_TURNS)
    # Centred: the camera state is that of the middle of the exposure.
    return tuple(advance(exposure, (i / steps - 0.5) * total_s) for i in range(steps + 1))


def find_ego_body(exposure: TracedExposure) -> int:
    """Number in hits of the ego body, 0 where no object is the body."""
    state = first_state(exposure)
    # By the mesh: at another time sample the body has another pose. From the end, where it is:
    # robots of one kind may share a mesh.
    for number in range(len(state.objects), 0, -1):
        if state.ego_body is not None and state.objects[number - 1].mesh is state.ego_body.mesh:
            return number
    return STATIC_SCENE


@np.errstate(divide="ignore")
def invert_ranges(inverse_range: Float32s) -> Float32s:
    """Ranges of inverse ranges, metres; inf of zero."""
    return np.asarray(1.0 / inverse_range, dtype=np.float32)


def assemble_grid(
    rays: RayTable, values: npt.NDArray[np.float32], *, fill: np.float32
) -> npt.NDArray[np.float32]:
    """(h * samples, w * samples, k) grid of (t, samples^2, 16, k) values of rays.

    Args:
        rays: Table that the values belong to.
        values: Values in the table's layout.
        fill: Value of samples in tiles without a ray.
    """
    samples, depth = rays.samples, values.shape[-1]
    side = TILE_PX * samples
    blocks = values.reshape(-1, samples, samples, TILE_PX, TILE_PX, depth)
    return assemble_tiles(rays, blocks.swapaxes(2, 3).reshape(-1, side, side, depth), fill=fill)


def assemble_tiles(
    rays: RayTable, tiles: npt.NDArray[Element], *, fill: Any
) -> npt.NDArray[Element]:
    """(h * s, w * s, k) image of the (t, 4 s, 4 s, k) tiles of a table, s elements a pixel's side.

    Args:
        rays: Table that the tiles belong to.
        tiles: Elements row by row in each tile; s is 1 for pixels, `rays.samples` for samples.
        fill: Value of elements in tiles without a ray.
    """
    side, depth = tiles.shape[1], tiles.shape[-1]
    rows, columns = -(-rays.height_px // TILE_PX), rays.num_tile_columns
    whole = np.full((rows * columns, side, side, depth), fill, dtype=tiles.dtype)
    whole[rays.tiles] = tiles
    grid = whole.reshape(rows, columns, side, side, depth).swapaxes(1, 2)
    image = grid.reshape(rows * side, columns * side, depth)
    scale = side // TILE_PX
    return image[: rays.height_px * scale, : rays.width_px * scale]
