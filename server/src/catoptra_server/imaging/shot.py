"""What is to be drawn: captured in one piece by the simulation, drawn later by another thread.

A shot holds everything that the picture depends on, so that the simulation may go on meanwhile. It
may consist of several takes, one for each tile of the screen.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from catoptra_protocol.camera_conf import Pairs
from catoptra_protocol.optics.camera import OmniCamera
from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_server.effects.effect import NO_WISHES, EffectWishes
from catoptra_server.imaging.multi_view import TileLayout
from catoptra_server.render.renderer import Exposure
from catoptra_server.robot.render_wish import RenderWish


@dataclass(frozen=True, slots=True)
class ScreenChannel:
    """What the image port shows: the whole screen, or one tile of a multi-view."""

    tile: int | None = None


@dataclass(frozen=True, slots=True)
class CameraChannel:
    """One robot's camera. Empty: the robot that the screen shows; that robot's first camera."""

    robot: str
    camera: str


Channel = ScreenChannel | CameraChannel
SCREEN = ScreenChannel()


@dataclass(frozen=True, slots=True)
class OmniEye:
    """An omnidirectional camera, and what its robot's file asks of the picture and its effects."""

    camera: OmniCamera
    wish: RenderWish
    effects: EffectWishes = NO_WISHES


# What can be looked through. Equal eyes share a prepared view.
Eye = OmniEye | PerspectiveCamera


@dataclass(frozen=True, slots=True, eq=False)
class Take:
    """An eye, where it is, and what moves about it."""

    eye: Eye
    exposure: Exposure


@dataclass(frozen=True, slots=True, eq=False)
class Caption:
    """Whose picture it is; empty where it is nobody's, or that of several cameras.

    robot_from_camera: where the effective viewpoint or pinhole sits. law: the pairs that give every
    pixel its direction in that frame. Both None without a camera.
    """

    robot: str = ""
    class_name: str = ""
    camera: str = ""
    world_from_robot: Pose = field(default_factory=Pose.identity)
    robot_from_camera: Pose | None = None
    law: Pairs | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Scenery:
    """The takes of a screen, tile by tile; None: a tile that stays black.

    interval_s: the shortest simulation time to the next exposure.
    """

    layout: TileLayout
    takes: tuple[Take | None, ...]
    caption: Caption = field(default_factory=Caption)
    interval_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """Scenery at a moment: time_s of the simulation, exposed_s on the server's monotonic clock.

    sequence counts the shots of a channel from 1.
    """

    channel: Channel
    sequence: int
    time_s: float
    exposed_s: float
    scenery: Scenery
