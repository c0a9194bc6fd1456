"""Rays of a frame in coherent packets without any shading: the most that a renderer can reach."""

from __future__ import annotations

from catoptra_server.capture.camera_state import CameraState
from catoptra_server.render.renderer import OmniView


def measure_bare_packets(view: OmniView, state: CameraState) -> bool | None:
    """Trace all rays of a view once, and write nothing; the caller takes the time.

    Returns:
        True once traced; None where the renderer offers no such call.
    """
    # PLACE FOR THE KERNEL'S CALL: catoptra_server.render.trace.kernel, one call that only traces.
    return None
