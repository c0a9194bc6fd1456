"""Replies about the server itself."""

from __future__ import annotations

from catoptra_protocol.stream.replies import CameraReply, Error
from catoptra_server.serve.stream.replies import camera_reply, status_reply
from catoptra_server.serve.stream.session import RobotSession
from helpers.fake_simulation import SERVER_INFO, FakeSimulation, create_fake_context
from helpers.loopback import run_scenario


def test_camera_is_found_by_name_and_an_unknown_one_is_an_error_with_the_known() -> None:
    async def scenario() -> None:
        robot = RobotSession(FakeSimulation().post, on_fault=lambda _: None)
        found = camera_reply(1, "omni", SERVER_INFO, robot)
        assert isinstance(found, CameraReply)
        assert (found.class_name, found.camera, found.plan) == (
            "USARBot.OmniP2AT",
            "Omni",
            "traced",
        )
        reason = "no camera 'Rear': this server's robots have Omni"
        assert camera_reply(2, "Rear", SERVER_INFO, robot) == Error(2, reason)

    run_scenario(scenario())


def test_status_counts_the_clients_of_all_transports() -> None:
    async def scenario() -> None:
        context = create_fake_context(FakeSimulation())
        context.clients.update({object(), object()})
        robot = RobotSession(context.post, on_fault=lambda _: None)
        status = status_reply(7, context, robot, num_sent=3)
        assert (status.id, status.num_clients, status.sent_frames) == (7, 2, 3)
        assert (status.world, status.has_robot) == ("field", False)

    run_scenario(scenario())
