"""Server information of the bundled robot and field."""

from __future__ import annotations

from catoptra_protocol.camera_conf import any_camera_from_pairs, omni_camera_from_pairs
from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.robot_file import read_robot
from catoptra_server.config.world_file import read_world
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.serve.stream.replies import (
    build_server_info,
    records_from_decisions,
    transform_from_pose,
)
from catoptra_server.simulation.robot_description import PerspectiveCameraDescription
from helpers.configs import FIELD, OMNI_ROBOT, ROBOTS
from helpers.robots import FORWARD_MOUNT, make_p2at


def test_server_info_of_the_bundled_robot_has_its_camera() -> None:
    robot, world = read_robot(OMNI_ROBOT)[0], read_world(FIELD)[0]
    assert robot.omni_camera is not None
    info = build_server_info(
        (robot,),
        world,
        clock="realtime",
        plans={(robot.class_name, robot.omni_camera.name): "traced"},
    )
    assert robot.omni_camera is not None
    camera = info.cameras[robot.class_name, robot.omni_camera.name]
    assert camera.plan == "traced"
    assert omni_camera_from_pairs(camera.camera_model)[0].width_px == 360
    assert info.class_names == (robot.class_name,)
    assert info.landmarks == world.landmarks
    assert [start.name for start in info.start_poses] == [start.name for start in world.starts]


def test_cameras_are_of_both_kinds_and_of_the_own_class_first() -> None:
    omni, real = read_robot(OMNI_ROBOT)[0], read_robot(ROBOTS / "p2at_omni_real.ini")[0]
    front = PerspectiveCameraDescription("Front", FORWARD_MOUNT, 64, 48, 0.8, 0.4, 1.6)
    only_front = make_p2at(
        class_name="USARBot.Plain", omni_cameras=(), perspective_cameras=(front,)
    )
    robots = (omni, only_front, real)
    info = build_server_info(robots, read_world(FIELD)[0], clock="realtime", plans={})

    def find(name: str, spawned_as: str) -> tuple[str, str]:
        found = info.find_camera(name, spawned_as=spawned_as)
        assert found is not None
        return found[0]

    assert find("", "")[0] == omni.class_name
    assert find("", "plain") == ("USARBot.Plain", "Front")
    assert find("", real.class_name)[0] == real.class_name
    assert find("FRONT", "") == ("USARBot.Plain", "Front")
    assert find("Front", omni.class_name) == ("USARBot.Plain", "Front")
    assert info.find_camera("Rear", spawned_as="") is None
    camera = info.cameras["USARBot.Plain", "Front"]
    assert any_camera_from_pairs(camera.camera_model) == PerspectiveCamera(64, 48, 0.8)
    assert camera.robot_from_mirror.translation.tolist() == list(FORWARD_MOUNT.position_m)


def test_transform_when_rotated_lists_the_matrix_row_by_row() -> None:
    transform = transform_from_pose(Pose.from_rpy((1.0, 2.0, 3.0), (0.0, 0.0, 1.5)))
    assert transform.position_m == (1.0, 2.0, 3.0)
    assert transform.rotation[1] < -0.9 < 0.9 < transform.rotation[3]


def test_effect_records_have_the_duration_of_each_enabled_pass() -> None:
    decisions = (
        EffectDecision("SelfView", True, 80.0, 0.5, "it is seen"),
        EffectDecision("Vignetting", True, 9.0, 0.5, "the rim"),
        EffectDecision("Blooming", False, 0.0, 0.5, "dim"),
    )
    records = records_from_decisions(decisions, {"trace": 7.0, "Vignetting": 1.5})
    assert [(one.name, one.enabled, one.duration_ms) for one in records] == [
        ("SelfView", True, None),
        ("Vignetting", True, 1.5),
        ("Blooming", False, None),
    ]
    assert (records[1].bound, records[1].threshold) == (9.0, 0.5)
    assert records[1].reason == "the rim"
