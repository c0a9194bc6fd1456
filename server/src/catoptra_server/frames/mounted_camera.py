"""The state of a camera on a robot, built in one function for every frame and every tool."""

from __future__ import annotations

from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.frames.frame_request import ViewRequest
from catoptra_server.frames.multi_view import Tile
from catoptra_server.frames.robot_camera import CameraRobot, RobotCamera, VisibleObjectsLookup
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.world.camera_state import ZERO_SEED, CameraState, NoiseSeed
from catoptra_server.world.objects import DynamicObject
from catoptra_server.world.world_description import AT_REST, Twist


def mounted_camera_state(
    world_from_robot: Pose,
    robot_from_camera: Pose,
    *,
    twist: Twist = AT_REST,
    objects: tuple[DynamicObject, ...] = (),
    ego_body: DynamicObject | None = None,
    noise_seed: NoiseSeed = ZERO_SEED,
) -> CameraState:
    """State of a camera for one exposure, given the state of the robot that carries the camera.

    Args:
        world_from_robot: Pose of the chassis.
        robot_from_camera: Pose of the viewpoint or pinhole on the robot.
        twist: Motion of the robot, referred to the chassis origin, in world axes.
        objects: Other dynamic objects in the scene; one whose box encloses the viewpoint is left
            out.
        ego_body: The robot itself, where the camera may show the robot's own body.
        noise_seed: Seed of the noise of this exposure.
    """
    world_from_camera = world_from_robot @ robot_from_camera
    # A turning chassis carries the camera around: v_camera = v_robot + omega x offset.
    offset_m = world_from_camera.translation - world_from_robot.translation
    camera_twist = twist if twist is AT_REST else twist.at_offset(offset_m)
    # From inside, a body would hide everything else, at up to 60 times the cost of the frame:
    # every ray meets it, and however slow, it passes by at any angular rate.
    visible = tuple(one for one in objects if not one.encloses(world_from_camera.translation))
    return CameraState(
        world_from_camera,
        visible,
        noise_seed=noise_seed,
        twist=camera_twist,
        ego_body=ego_body,
    )


@dataclass(frozen=True, slots=True, eq=False)
class MountedCamera:
    """A camera and the robot that carries it."""

    robot: CameraRobot
    camera: RobotCamera

    def request_view(self, tile: Tile, visible_objects_of: VisibleObjectsLookup) -> ViewRequest:
        """View of the camera now, at the size of a tile."""
        # Pose, twist and tick of one instant: the simulation thread moves nothing meanwhile.
        robot, visible = self.robot, visible_objects_of(self.robot)
        spec = self.camera.camera_spec(tile)
        state = mounted_camera_state(
            robot.world_from_robot,
            self.camera.robot_from_camera(robot.joint_angles_rad),
            twist=robot.twist,
            objects=visible.objects,
            # No effect of a camera without a mirror shows the robot itself.
            ego_body=visible.ego_body if isinstance(spec, OmniCameraSpec) else None,
            noise_seed=robot.noise_seed_for(self.camera.name),
        )
        return ViewRequest(spec, state)
