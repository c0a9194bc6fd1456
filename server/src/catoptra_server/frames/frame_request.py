"""What is to be drawn: captured in one piece by the simulation, drawn later by another thread.

A shot holds everything that the picture depends on, so that the simulation may go on meanwhile. It
may consist of several takes, one for each tile of the screen.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from catoptra_protocol.camera_conf import Pairs
from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.effects.effect import NO_EFFECT_SETTINGS, EffectSettings
from catoptra_server.frames.multi_view import TileLayout
from catoptra_server.robot.render_settings import RenderSettings


@dataclass(frozen=True, slots=True)
class ImagePortChannel:
    """What the image port shows: the whole screen, or one tile of a multi-view."""

    tile: int | None = None


@dataclass(frozen=True, slots=True)
class CameraChannel:
    """One robot's camera. Empty: the robot that the screen shows; that robot's first camera."""

    robot: str
    camera: str


Channel = ImagePortChannel | CameraChannel
IMAGE_PORT = ImagePortChannel()


@dataclass(frozen=True, slots=True)
class OmniCameraSpec:
    """An omnidirectional camera, and what its robot's file asks of the picture and its effects."""

    camera: OmniCamera
    render_settings: RenderSettings
    effect_settings: EffectSettings = NO_EFFECT_SETTINGS


# What can be looked through. Equal eyes share a prepared view.
CameraSpec = OmniCameraSpec | PerspectiveCamera


@dataclass(frozen=True, slots=True, eq=False)
class ViewRequest:
    """An eye, where it is, and what moves about it."""

    camera: CameraSpec
    camera_state: CameraState


@dataclass(frozen=True, slots=True, eq=False)
class FrameMetadata:
    """Whose picture it is; empty where it is nobody's, or that of several cameras.

    robot_from_camera: where the effective viewpoint or pinhole sits. law: the pairs that give every
    pixel its direction in that frame. Both None without a camera.
    """

    robot: str = ""
    class_name: str = ""
    camera: str = ""
    world_from_robot: Pose = field(default_factory=Pose.identity)
    robot_from_camera: Pose | None = None
    camera_model: Pairs | None = None


@dataclass(frozen=True, slots=True, eq=False)
class FrameComposition:
    """The takes of a screen, tile by tile; None: a tile that stays black.

    interval_s: the shortest simulation time to the next exposure.
    """

    layout: TileLayout
    views: tuple[ViewRequest | None, ...]
    metadata: FrameMetadata = field(default_factory=FrameMetadata)
    min_interval_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class FrameRequest:
    """Scenery at a moment: time_s of the simulation, exposed_at_s on the server's monotonic clock.

    sequence counts the shots of a channel from 1.
    """

    channel: Channel
    sequence: int
    time_s: float
    exposed_at_s: float
    composition: FrameComposition
