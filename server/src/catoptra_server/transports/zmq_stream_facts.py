"""What the stream tells of a server, and what does not change while it runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version

from catoptra_protocol.camera_conf import Pairs, pairs_from_camera
from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.wire.stream_answers import EffectRecord, Placement, StartRecord
from catoptra_server.effects.decide import Decision
from catoptra_server.robot.description import RobotDescription
from catoptra_server.scene.description import World

CameraKey = tuple[str, str]  # class of the robot, name of the camera


@dataclass(frozen=True, slots=True, eq=False)
class CameraFacts:
    """A camera's law, as the pairs of CONF, where its viewpoint sits, and how it is drawn."""

    law: Pairs
    robot_from_mirror: Pose
    plan: str | None = None


@dataclass(frozen=True, slots=True, eq=False)
class StreamFacts:
    """Classes that can be spawned, the clock, and cameras by class and name."""

    server: str
    world: str
    class_names: tuple[str, ...]
    clock: str
    cameras: dict[CameraKey, CameraFacts]
    landmarks: tuple[Landmark, ...]
    starts: tuple[StartRecord, ...]


def facts_of(
    robots: Sequence[RobotDescription], world: World, *, clock: str, plans: Mapping[str, str]
) -> StreamFacts:
    """Return the facts of a server; plans by class name."""
    cameras: dict[CameraKey, CameraFacts] = {}
    for robot in robots:
        omni = robot.omni_camera
        if omni is not None:
            law = pairs_from_camera(omni.camera, robot.viewpoint_height_m)
            plan = plans.get(robot.class_name)
            cameras[robot.class_name, omni.name] = CameraFacts(law, omni.robot_from_mirror, plan)
    return StreamFacts(
        server=f"Catoptra {version('catoptra-server')}",
        world=world.name,
        class_names=tuple(robot.class_name for robot in robots),
        clock=clock,
        cameras=cameras,
        landmarks=world.landmarks,
        starts=tuple(StartRecord(s.name, s.location_m, s.rotation_rad) for s in world.starts),
    )


def placement(pose: Pose) -> Placement:
    """Return a pose as it is sent."""
    x, y, z = map(float, pose.translation)
    a, b, c, d, e, f, g, h, i = map(float, pose.rotation.ravel())
    return Placement((x, y, z), (a, b, c, d, e, f, g, h, i))


def effect_records(
    decisions: Sequence[Decision], stage_ms: Mapping[str, float]
) -> tuple[EffectRecord, ...]:
    """Return decisions as they are sent; stage_ms: of the picture that they were taken for."""
    return tuple(_record(decision, stage_ms.get(decision.effect)) for decision in decisions)


def _record(decision: Decision, ms: float | None) -> EffectRecord:
    return EffectRecord(
        name=decision.effect,
        is_on=decision.is_on,
        bound=decision.bound,
        threshold=decision.threshold,
        unit=decision.unit,
        reason=decision.reason,
        ms=None if ms is None else float(ms),
    )
