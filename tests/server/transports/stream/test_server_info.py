"""What the stream tells of the shipped robot and field."""

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


def test_facts_when_of_the_shipped_robot_hold_its_camera() -> None:
    robot, world = read_robot(OMNI_ROBOT)[0], read_world(FIELD)[0]
    facts = build_server_info((robot,), world, clock="realtime", plans={robot.class_name: "traced"})
    assert robot.omni_camera is not None
    camera = facts.cameras[robot.class_name, robot.omni_camera.name]
    assert camera.plan == "traced"
    assert omni_camera_from_pairs(camera.camera_model)[0].width_px == 360
    assert facts.class_names == (robot.class_name,)
    assert facts.landmarks == world.landmarks
    assert [start.name for start in facts.start_poses] == [start.name for start in world.starts]


def test_placement_when_turned_lists_the_rotation_row_by_row() -> None:
    sent = transform_from_pose(Pose.from_rpy((1.0, 2.0, 3.0), (0.0, 0.0, 1.5)))
    assert sent.position_m == (1.0, 2.0, 3.0)
    assert sent.rotation[1] < -0.9 < 0.9 < sent.rotation[3]


def test_effects_when_sent_say_what_each_that_runs_took() -> None:
    decisions = (
        EffectDecision("SelfView", True, 80.0, 0.5, "px", "it is seen"),
        EffectDecision("Vignetting", True, 9.0, 0.5, "grey levels", "the rim"),
        EffectDecision("Blooming", False, 0.0, 0.5, "grey levels", "dim"),
    )
    sent = records_from_decisions(decisions, {"trace": 7.0, "Vignetting": 1.5})
    assert [(one.name, one.enabled, one.duration_ms) for one in sent] == [
        ("SelfView", True, None),
        ("Vignetting", True, 1.5),
        ("Blooming", False, None),
    ]
    assert (sent[1].bound, sent[1].threshold, sent[1].unit) == (9.0, 0.5, "grey levels")
    assert sent[1].reason == "the rim"
