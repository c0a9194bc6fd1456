"""The report of start places."""

from __future__ import annotations

from catoptra_protocol.usarsim.reports import StartPose, StartPoses
from catoptra_server.world.world_description import report_start_poses
from helpers.robots import make_walled_world


def test_report_has_the_starts_in_their_order() -> None:
    assert report_start_poses(make_walled_world().starts) == StartPoses(
        (
            StartPose("Centre", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
            StartPose("Aside", (1.0, -2.0, 0.3), (0.1, 0.2, 1.5)),
        )
    )
