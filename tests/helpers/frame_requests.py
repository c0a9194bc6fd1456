"""Requests of small frames, for tests of what renders them."""

from __future__ import annotations

from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.frames.frame import IMAGE_PORT, FrameComposition, FrameRequest, ViewRequest
from catoptra_server.frames.multi_view import TileLayout
from catoptra_server.frames.plan.camera import PerspectiveCameraSpec
from catoptra_server.world.objects import CameraState

VIEW = ViewRequest(
    PerspectiveCameraSpec(PerspectiveCamera(4, 3, 1.0)), CameraState(Pose.identity())
)
SINGLE = TileLayout(1, 1, 4, 3, 4, 3)


def make_request(
    *views: ViewRequest | None, layout: TileLayout = SINGLE, sequence: int = 1
) -> FrameRequest:
    """Request of the image port at 0.5 s of simulation time."""
    return FrameRequest(IMAGE_PORT, sequence, 0.5, 2.0, FrameComposition(layout, views))
