"""A plan request passes through simulation and render thread, and has one reply."""

from __future__ import annotations

import asyncio

from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_protocol.stream.replies import Error, PlanReply, Reply
from catoptra_protocol.stream.requests import GetStatusRequest, SetAccuracyRequest
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.render_thread import PlanCallback, PlanFailure
from catoptra_server.render.render_settings import AccuracyTarget, RenderSettings
from catoptra_server.serve.stream.replies import request_plan
from catoptra_server.serve.stream.session import PendingRequests, RobotSession
from catoptra_server.simulation import AccuracyTargetChanged, Fault, SimulationEvent
from helpers.fake_simulation import FakeSimulation, serve_fake_simulation
from helpers.loopback import run_scenario
from helpers.robots import CAMERA
from helpers.stream_peer import connect_raw_peer


def query_plan(
    request: SetAccuracyRequest, *, result: Fault | str | None = "camera"
) -> tuple[Reply, list[AccuracyTargetChanged]]:
    """Reply of a server whose simulation finds a camera or this result; the posted events."""
    simulation = FakeSimulation()
    replies: list[Reply] = []

    async def scenario() -> None:
        async with serve_fake_simulation(simulation) as server:
            with connect_raw_peer(server.port) as peer:
                await peer.send(bytes_from_message(request))
                await peer.send(bytes_from_message(GetStatusRequest(99)))
                replies.append((await peer.receive())[0])  # an error, or the status
                for change in accuracy_changes(simulation):
                    target = AccuracyTarget().with_changes(
                        max_error_px=change.max_error_px, budget_ms=change.budget_ms
                    )
                    spec = OmniCameraSpec(CAMERA.camera, RenderSettings(accuracy_target=target))
                    found = spec if isinstance(result, str) else result
                    change.reply(found, change.camera or "Omni")
                    replies.append((await peer.receive())[0])

    run_scenario(scenario())
    return (replies[-1], accuracy_changes(simulation))


def accuracy_changes(simulation: FakeSimulation) -> list[AccuracyTargetChanged]:
    return [event for event in simulation.posted_events if isinstance(event, AccuracyTargetChanged)]


def test_plan_when_a_tolerance_is_set_describes_the_resulting_plan() -> None:
    reply, posted = query_plan(SetAccuracyRequest(1, "", 0.5, None))
    assert isinstance(reply, PlanReply)
    assert (reply.id, reply.camera, reply.max_error_px, reply.budget_ms) == (1, "Omni", 0.5, 0)
    assert reply.error_bounds is not None
    assert reply.error_bound_px == reply.error_bounds["outline_px"]
    assert (reply.median_frame_ms, reply.cost_ms, reply.more_accurate) == (12.5, None, None)
    assert [(p.camera, p.max_error_px, p.budget_ms) for p in posted] == [("", 0.5, None)]


def test_plan_of_a_missing_camera_is_an_error() -> None:
    reply, _ = query_plan(SetAccuracyRequest(2, "Rear", None, None), result=None)
    assert isinstance(reply, Error)
    assert "no robot with an omnidirectional camera 'Rear'" in reply.reason


def test_plan_when_superseded_in_the_simulation_is_an_error_with_the_reason() -> None:
    reply, _ = query_plan(SetAccuracyRequest(2, "", 0.5, None), result=Fault("superseded"))
    assert reply == Error(2, "superseded")


def test_plan_when_the_render_thread_has_none_is_an_error_with_the_reason() -> None:
    async def scenario() -> None:
        replies: asyncio.Queue[Reply] = asyncio.Queue()
        clients = []

        def post(event: SimulationEvent) -> bool:
            assert isinstance(event, AccuracyTargetChanged)
            event.reply(OmniCameraSpec(CAMERA.camera, RenderSettings()), "Omni")
            return True

        def find_no_plan(client: object, camera: OmniCameraSpec, reply: PlanCallback) -> None:
            clients.append(client)
            reply(PlanFailure("no plan"))

        session = RobotSession(post, on_fault=print)
        pending = PendingRequests(replies.put_nowait).add(4)
        request_plan(SetAccuracyRequest(4, "", None, None), pending, session, find_no_plan)
        assert await replies.get() == Error(4, "no plan")
        assert clients == [session]

    run_scenario(scenario())


def test_plan_with_a_negative_budget_is_an_error_before_any_change() -> None:
    reply, posted = query_plan(SetAccuracyRequest(3, "", None, -1.0))
    assert reply == Error(3, "budget_ms must be 0 (no target) or more, not -1.0")
    assert posted == []
