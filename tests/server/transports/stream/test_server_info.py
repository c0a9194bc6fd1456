"""Server information of the bundled robot and field."""

from __future__ import annotations

from catoptra_protocol.camera_conf import omni_camera_from_pairs
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.robot_file import read_robot
from catoptra_server.config.world_file import read_world
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.transports.stream.server_info import (
    build_server_info,
    records_from_decisions,
    transform_from_pose,
)
from helpers.configs import FIELD, OMNI_ROBOT


def test_server_info_of_the_bundled_robot_has_its_camera() -> None:
    robot, world = read_robot(OMNI_ROBOT)[0], read_world(FIELD)[0]
    info = build_server_info((robot,), world, clock="realtime", plans={robot.class_name: "traced"})
    assert robot.omni_camera is not None
    camera = info.cameras[robot.class_name, robot.omni_camera.name]
    assert camera.plan == "traced"
    assert omni_camera_from_pairs(camera.camera_model)[0].width_px == 360
    assert info.class_names == (robot.class_name,)
    assert info.landmarks == world.landmarks
    assert [start.name for start in info.start_poses] == [start.name for start in world.starts]


def test_transform_when_rotated_lists_the_matrix_row_by_row() -> None:
    transform = transform_from_pose(Pose.from_rpy((1.0, 2.0, 3.0), (0.0, 0.0, 1.5)))
    assert transform.position_m == (1.0, 2.0, 3.0)
    assert transform.rotation[1] < -0.9 < 0.9 < transform.rotation[3]


def test_effect_records_have_the_duration_of_each_enabled_pass() -> None:
    decisions = (
        EffectDecision("SelfView", True, 80.0, 0.5, "px", "it is seen"),
        EffectDecision("Vignetting", True, 9.0, 0.5, "grey levels", "the rim"),
        EffectDecision("Blooming", False, 0.0, 0.5, "grey levels", "dim"),
    )
    records = records_from_decisions(decisions, {"trace": 7.0, "Vignetting": 1.5})
    assert [(one.name, one.enabled, one.duration_ms) for one in records] == [
        ("SelfView", True, None),
        ("Vignetting", True, 1.5),
        ("Blooming", False, None),
    ]
    assert (records[1].bound, records[1].threshold, records[1].unit) == (9.0, 0.5, "grey levels")
    assert records[1].reason == "the rim"
