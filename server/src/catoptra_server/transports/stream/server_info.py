"""What the stream tells of a server, and what does not change while it runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version

from catoptra_protocol.camera_conf import Pairs, pairs_from_omni_camera
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.stream.replies import EffectRecord, StartPoseRecord, Transform
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.robot.robot_description import RobotDescription
from catoptra_server.scene.world_description import World

CameraKey = tuple[str, str]  # class of the robot, name of the camera


@dataclass(frozen=True, slots=True, eq=False)
class CameraInfo:
    """A camera's law, as the pairs of CONF, where its viewpoint sits, and how it is drawn."""

    camera_model: Pairs
    robot_from_mirror: Pose
    plan: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class ServerInfo:
    """Classes that can be spawned, the clock, and cameras by class and name."""

    server: str
    world: str
    class_names: tuple[str, ...]
    clock: str
    cameras: dict[CameraKey, CameraInfo]
    landmarks: tuple[Landmark, ...]
    start_poses: tuple[StartPoseRecord, ...]


def build_server_info(
    robots: Sequence[RobotDescription], world: World, *, clock: str, plans: Mapping[str, str]
) -> ServerInfo:
    """Return the facts of a server; plans by class name."""
    cameras: dict[CameraKey, CameraInfo] = {}
    for robot in robots:
        omni = robot.omni_camera
        if omni is not None:
            law = pairs_from_omni_camera(omni.camera, robot.viewpoint_height_m)
            plan = plans.get(robot.class_name)
            cameras[robot.class_name, omni.name] = CameraInfo(law, omni.robot_from_mirror, plan)
    return ServerInfo(
        server=f"Catoptra {version('catoptra-server')}",
        world=world.name,
        class_names=tuple(robot.class_name for robot in robots),
        clock=clock,
        cameras=cameras,
        landmarks=world.landmarks,
        start_poses=tuple(
            StartPoseRecord(s.name, s.location_m, s.rotation_rad) for s in world.starts
        ),
    )


def transform_from_pose(pose: Pose) -> Transform:
    """Return a pose as it is sent."""
    x, y, z = map(float, pose.translation)
    a, b, c, d, e, f, g, h, i = map(float, pose.rotation.ravel())
    return Transform((x, y, z), (a, b, c, d, e, f, g, h, i))


def records_from_decisions(
    decisions: Sequence[EffectDecision], stage_ms: Mapping[str, float]
) -> tuple[EffectRecord, ...]:
    """Return decisions as they are sent; stage_ms: of the picture that they were taken for."""
    return tuple(
        _record_from_decision(decision, stage_ms.get(decision.effect)) for decision in decisions
    )


def _record_from_decision(decision: EffectDecision, ms: float | None) -> EffectRecord:
    return EffectRecord(
        name=decision.effect,
        enabled=decision.enabled,
        bound=decision.bound,
        threshold=decision.threshold,
        unit=decision.unit,
        reason=decision.reason,
        duration_ms=None if ms is None else float(ms),
    )
