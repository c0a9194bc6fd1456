"""Start places of a world as the control protocol reports them."""

from __future__ import annotations

from collections.abc import Sequence

from catoptra_protocol.usarsim.reports import StartPose, StartPoses
from catoptra_server.scene.world_description import StartPlace


def report_start_poses(starts: Sequence[StartPlace]) -> StartPoses:
    """Report of all start places, in the order of the world file."""
    return StartPoses(tuple(StartPose(s.name, s.location_m, s.rotation_rad) for s in starts))
