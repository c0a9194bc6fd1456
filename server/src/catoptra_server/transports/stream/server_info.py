"""Constant information about the server for replies of the stream, and conversions to records."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from catoptra_protocol.camera_conf import Pairs, pairs_from_omni_camera
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_protocol.stream.replies import EffectRecord, StartPoseRecord
from catoptra_protocol.stream.requests import Transform
from catoptra_server import __version__
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.simulation.robot_description import RobotDescription
from catoptra_server.simulation.sensors.perspective_camera import PerspectiveCameraSensor
from catoptra_server.simulation.spawning import find_class
from catoptra_server.world.world_description import World

# Class of the robot, name of the camera.
CameraKey = tuple[str, str]


@dataclass(frozen=True, slots=True, eq=False)
class CameraInfo:
    """A camera of a robot class, of either kind."""

    camera_model: Pairs
    """Pairs of CONF."""
    robot_from_mirror: Pose
    """Pose of the effective viewpoint, or of the pinhole with all joints at 0."""
    plan: str | None = None
    """Description of the rendering plan, if known at the start; None for a perspective camera."""


@dataclass(frozen=True, slots=True, eq=False)
class ServerInfo:
    """Server, world, robot classes, clock, cameras, landmarks and start poses."""

    server: str
    """Product and release."""
    world: str
    """Name of the world."""
    robots: tuple[RobotDescription, ...]
    """Robot classes that can be spawned."""
    clock: str
    """`realtime` or `lockstep`."""
    cameras: dict[CameraKey, CameraInfo]
    """Cameras by class of the robot and name of the camera, the omnidirectional one of a class
    first."""
    landmarks: tuple[Landmark, ...]
    start_poses: tuple[StartPoseRecord, ...]

    @property
    def class_names(self) -> tuple[str, ...]:
        """Names of the robot classes."""
        return tuple(robot.class_name for robot in self.robots)

    def find_camera(self, name: str, *, spawned_as: str) -> tuple[CameraKey, CameraInfo] | None:
        """Camera of a name in any case, of the class of a robot or else of the first that has it.

        Args:
            name: Name of the camera; empty for the first one.
            spawned_as: Class of the client's robot as its spawn request names it; empty without a
                robot.
        """
        own = find_class(self.robots, spawned_as).class_name if spawned_as else ""
        found = [
            (key, info)
            for key, info in self.cameras.items()
            if name.lower() in ("", key[1].lower())
        ]
        # False sorts before True, and the order of the classes is kept.
        return min(found, key=lambda entry: entry[0][0] != own, default=None)


def build_server_info(
    robots: Sequence[RobotDescription], world: World, *, clock: str, plans: Mapping[CameraKey, str]
) -> ServerInfo:
    """Collect the information about a server.

    Args:
        robots: Robot classes.
        world: World.
        clock: `realtime` or `lockstep`.
        plans: Description of the rendering plan by camera.
    """
    cameras: dict[CameraKey, CameraInfo] = {}
    # Cameras of classes and not of robots, so that clients can read a model before any robot
    # exists.
    for robot in robots:
        cameras |= _cameras_of_class(robot, plans)
    return ServerInfo(
        server=f"Catoptra {__version__}",
        world=world.name,
        robots=tuple(robots),
        clock=clock,
        cameras=cameras,
        landmarks=world.landmarks,
        start_poses=tuple(
            StartPoseRecord(s.name, s.location_m, s.rotation_rad) for s in world.starts
        ),
    )


def _cameras_of_class(
    robot: RobotDescription, plans: Mapping[CameraKey, str]
) -> dict[CameraKey, CameraInfo]:
    cameras: dict[CameraKey, CameraInfo] = {}
    for omni in robot.omni_cameras:
        pairs = pairs_from_omni_camera(omni.camera, robot.viewpoint_height_m(omni))
        mount = robot.robot_from_omni(omni, {})
        cameras[robot.class_name, omni.name] = CameraInfo(
            pairs, mount, plans.get((robot.class_name, omni.name))
        )
    for description in robot.perspective_cameras:
        camera = PerspectiveCameraSensor(description, robot)
        info = CameraInfo(camera.camera_model(), camera.robot_from_camera({}))
        cameras[robot.class_name, camera.name] = info
    return cameras


def transform_from_pose(pose: Pose) -> Transform:
    """Transform of a pose, for a message."""
    # msgpack encodes Python's floats, not those of NumPy.
    x, y, z = map(float, pose.translation)
    a, b, c, d, e, f, g, h, i = map(float, pose.rotation.ravel())
    return Transform((x, y, z), (a, b, c, d, e, f, g, h, i))


def records_from_decisions(
    decisions: Sequence[EffectDecision], stage_ms: Mapping[str, float]
) -> tuple[EffectRecord, ...]:
    """Records of effect decisions, with the durations of a frame by stage."""
    # A disabled effect has no stage, and one that changes the scene has none of its own.
    return tuple(
        _record_from_decision(decision, stage_ms.get(decision.effect)) for decision in decisions
    )


def _record_from_decision(decision: EffectDecision, ms: float | None) -> EffectRecord:
    return EffectRecord(
        name=decision.effect,
        enabled=decision.enabled,
        bound=decision.bound,
        threshold=decision.threshold,
        displacement_px=decision.displacement_px,
        reason=decision.reason,
        duration_ms=None if ms is None else float(ms),
        basis=decision.basis.value,
        change=decision.change,
    )
