"""Frames to render, described completely by the simulation and rendered later in another thread.

A request holds everything that the image depends on, frozen, so that the simulation goes on while
the frame is rendered. One frame may consist of several views, one for each tile.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import field

from catoptra_protocol.camera_conf import Pairs
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.frames.multi_view import TileLayout
from catoptra_server.ground_truth.label_rays import DrawnExposure
from catoptra_server.planning.camera_spec import CameraSpec
from catoptra_server.planning.camera_variant import CameraVariant
from catoptra_server.render.trace.trace_engine import LabelRequest
from catoptra_server.world.camera_state import CameraState


@dataclass(frozen=True, slots=True)
class ImagePortChannel:
    """The image of the image port, or one tile of a multi-view."""

    tile: int | None = None
    """Index of the tile; None for the whole image."""


@dataclass(frozen=True, slots=True)
class CameraChannel:
    """One camera of one robot, at the camera's own size."""

    robot: str
    """Name of the robot; empty for the robot that the image port displays."""
    camera: str
    """Name of the camera in any case; empty for the robot's first camera."""
    variant: CameraVariant | None = None
    """Other settings, of an omnidirectional camera; None for those of the camera."""


# Compared by value: channels are keys of mailboxes and of the scheduler.
Channel = ImagePortChannel | CameraChannel
IMAGE_PORT = ImagePortChannel()


def is_variant(channel: Channel) -> bool:
    """Whether a channel shows a camera by other settings than its own."""
    return isinstance(channel, CameraChannel) and channel.variant is not None


# Labels that can be found along the rays of a picture; None for none.
LabelRequester = Callable[[DrawnExposure], LabelRequest | None]


# eq=False here and below: states hold arrays, whose comparison is no truth value.
@dataclass(frozen=True, slots=True, eq=False)
class ViewRequest:
    """One camera to render, in one state."""

    camera: CameraSpec
    camera_state: CameraState
    request_labels: LabelRequester | None = None
    """Labels that are to be found while the view is drawn; None for none."""


@dataclass(frozen=True, slots=True, eq=False)
class FrameMetadata:
    """Robot and camera of a frame; empty for a frame of several robots or none."""

    robot: str = ""
    class_name: str = ""
    camera: str = ""
    """Name of the camera; empty for a frame of several cameras."""
    world_from_robot: Pose = field(default_factory=Pose.identity)
    robot_from_camera: Pose | None = None
    """Pose of the effective viewpoint or pinhole; None without a single camera."""
    camera_model: Pairs | None = None
    """Key-value pairs of the camera model, enough to compute the direction of every pixel; None
    without a single camera."""


@dataclass(frozen=True, slots=True, eq=False)
class FrameComposition:
    """Views of a frame, tile by tile."""

    layout: TileLayout
    views: tuple[ViewRequest | None, ...]
    """None: a tile that stays black."""
    metadata: FrameMetadata = field(default_factory=FrameMetadata)
    min_interval_s: float = 0.0
    """Shortest simulation time to the next exposure of the same channel."""
    reference: ViewRequest | None = None
    """View to compare a single view with; None for no comparison."""
    is_turned: bool = False
    """Whether the pictures are turned round left to right."""
    channels: tuple[str, ...] = ()
    """Channels of labels that are wanted beside a single view."""


@dataclass(frozen=True, slots=True, eq=False)
class FrameRequest:
    """A composition captured at one time."""

    channel: Channel
    sequence: int
    """Number of the frame within the channel, from 1."""
    time_s: float
    """Simulation time of the exposure."""
    exposed_at_s: float
    """Time of the exposure on the server's monotonic clock."""
    composition: FrameComposition
