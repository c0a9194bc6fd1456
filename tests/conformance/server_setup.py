"""Our own running server as the suite sees it."""

from __future__ import annotations

from conformance.check import ServerUnderTest
from helpers.server_process import RunningServer


def server_under_test(
    server: RunningServer,
    *,
    robot_class: str = "USARBot.OmniP2AT",
    spawn_pose: str = "",
    dialect: str = "ut2004",
    legacy_images: bool = False,
) -> ServerUnderTest:
    """Server with all three ports."""
    ports = {
        "control": server.control_port,
        "image": server.image_port,
        "stream": server.stream_port,
    }
    return ServerUnderTest(
        {name: ("127.0.0.1", port) for name, port in ports.items()},
        robot_class,
        spawn_pose,
        dialect,
        legacy_images,
    )
