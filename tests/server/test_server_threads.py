"""The two threads without any port: which is started, what is prepared, and their end."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_protocol.usarsim.commands import Init
from catoptra_server.commands.server import Options, ServerThreads
from catoptra_server.config.server_file import ServerOptions
from catoptra_server.config.startup import read_startup_config
from catoptra_server.frames.frame import CameraChannel
from catoptra_server.simulation import ClockMode, CommandReceived
from helpers.configs import Edit, write_edited_copy, write_small_world
from helpers.loopback import run_scenario
from helpers.robots import FakeClient
from helpers.server_process import write_small_robot


def make_threads(robot_file: Path, folder: Path, clock: ClockMode) -> ServerThreads:
    options = Options(
        robot_files=(robot_file,),
        world_file=write_small_world(folder),
        server_options=ServerOptions(control_port=0, image_port=0),
        renderer="trace",
        threads=1,
        clock=clock,
    )
    startup = read_startup_config(options.robot_files, options.world_file, None)
    return ServerThreads(startup, options, on_failure=lambda: pytest.fail("a thread failed"))


@pytest.mark.parametrize("clock", ClockMode)
def test_frame_of_a_spawned_robot_arrives_in_its_mailbox(tmp_path: Path, clock: ClockMode) -> None:
    async def scenario() -> None:
        threads, client = make_threads(write_small_robot(tmp_path), tmp_path, clock), FakeClient()
        async with threads.run():
            threads.simulation.post(CommandReceived(client, Init("OmniP2AT", "R", (0.0, 0.0, 0.0))))
            mailbox = threads.mailboxes.get(CameraChannel("", ""))
            frame = await mailbox.wait_for_newer(0)
        assert (frame.metadata.robot, frame.plan) == ("R", *threads.plans.values())
        assert client.spawns == [("R", None)]

    run_scenario(scenario())


def test_plans_of_a_server_without_cameras_are_none(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    async def scenario() -> None:
        robot_file = write_small_robot(tmp_path)
        write_edited_copy(robot_file, tmp_path, Edit('ItemName="OmniCam",', 'ItemName="",'))
        threads = make_threads(robot_file, tmp_path, ClockMode.LOCKSTEP)
        with caplog.at_level("INFO"):
            async with threads.run():
                pass
        assert threads.plans == {}

    run_scenario(scenario())
    assert "no renderer is started" in caplog.text
