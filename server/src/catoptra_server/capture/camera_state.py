"""Pose, motion and surroundings of a camera during one exposure.

Everything that changes from frame to frame, and nothing else: camera model, plan and scene stay the
same and belong to a view. Effects, bounds and renderers all read this one description.
"""

from __future__ import annotations

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.capture.fog_medium import FogMedium
from catoptra_server.capture.noise_seed import ZERO_SEED, NoiseSeed
from catoptra_server.capture.shutter import Shutter
from catoptra_server.scene.dynamic_object import DynamicObject
from catoptra_server.scene.twist import AT_REST, Twist


@dataclass(frozen=True, slots=True, eq=False)
class CameraState:
    """State of a camera in one exposure."""

    world_from_mirror: Pose
    """Mirror frame of an omnidirectional camera, its origin the effective viewpoint; the camera
    frame (x ahead, y right, z down) of a perspective camera."""
    objects: tuple[DynamicObject, ...] = ()
    """Dynamic objects in view beside the scene, without the robot that carries the camera."""
    noise_seed: NoiseSeed = ZERO_SEED
    """Seed of the image noise, read only by effects that draw random numbers."""
    twist: Twist = AT_REST
    """Motion of the frame in the world, referred to the frame's origin."""
    ego_body: DynamicObject | None = None
    """Robot that carries the camera; in view only after the effect `SelfView` has added this body
    to `objects`."""
    has_shadows: bool = False
    """Whether surfaces occlude directional and point lights."""
    fog: FogMedium | None = None
    """Air between camera and surfaces; None for clear air."""
    shutter: Shutter | None = None
    """Exposure and readout times; None for an exposure too short for any motion to show."""


def scene_twist_in_mirror(camera_state: CameraState) -> Twist:
    """Motion of the static scene as the camera sees it: in the mirror frame, at the viewpoint."""
    if camera_state.twist is AT_REST:
        return AT_REST
    # Plain floats: computed for every frame, and a tenth of the time of arrays of three.
    axes = camera_state.world_from_mirror.rotation.T.tolist()
    linear, angular = (
        tuple(-(a * x + b * y + c * z) for a, b, c in axes)
        for x, y, z in (camera_state.twist.linear_m_s, camera_state.twist.angular_rad_s)
    )
    return Twist(linear, angular)
