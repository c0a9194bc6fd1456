"""The question goes through the simulation and the drawing thread, and comes back as one answer."""

from __future__ import annotations

from catoptra_protocol.stream.messages import bytes_from_message
from catoptra_protocol.stream.replies import Error, PlanReply, Reply
from catoptra_protocol.stream.requests import GetStatusRequest, SetAccuracyRequest
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.robot.render_settings import AccuracyTarget, RenderSettings
from catoptra_server.simulation import AccuracyTargetChanged
from helpers.fake_simulation import FakeSimulation, serve_fake_simulation
from helpers.loopback import run_scenario
from helpers.robots import CAMERA
from helpers.stream_peer import connect_raw_peer


def query_plan(
    request: SetAccuracyRequest, *, has_camera: bool = True
) -> tuple[Reply, list[AccuracyTargetChanged]]:
    """Return the answer of a server whose simulation has, or has not, a camera; and its posts."""
    scene = FakeSimulation()
    answers: list[Reply] = []

    async def scenario() -> None:
        async with serve_fake_simulation(scene) as server:
            with connect_raw_peer(server.port) as peer:
                await peer.send(bytes_from_message(request))
                await peer.send(bytes_from_message(GetStatusRequest(99)))
                answers.append((await peer.receive())[0])  # refused at once, or the status
                for turned in accuracy_changes(scene):
                    dial = AccuracyTarget().with_changes(
                        max_error_px=turned.max_error_px, budget_ms=turned.budget_ms
                    )
                    eye = OmniCameraSpec(CAMERA.camera, RenderSettings(accuracy_target=dial))
                    turned.reply(eye if has_camera else None, turned.camera or "Omni")
                    answers.append((await peer.receive())[0])

    run_scenario(scenario())
    return (answers[-1], accuracy_changes(scene))


def accuracy_changes(scene: FakeSimulation) -> list[AccuracyTargetChanged]:
    return [post for post in scene.posted_events if isinstance(post, AccuracyTargetChanged)]


def test_plan_when_a_tolerance_is_asked_tells_how_the_camera_is_drawn_by_it() -> None:
    answer, posted = query_plan(SetAccuracyRequest(1, "", 0.5, None))
    assert isinstance(answer, PlanReply)
    assert (answer.id, answer.camera, answer.max_error_px, answer.budget_ms) == (1, "Omni", 0.5, 0)
    assert answer.error_bounds is not None
    assert answer.error_bound_px == answer.error_bounds["outline_px"]
    assert (answer.median_frame_ms, answer.cost_ms, answer.more_accurate) == (12.5, None, None)
    assert [(p.camera, p.max_error_px, p.budget_ms) for p in posted] == [("", 0.5, None)]


def test_plan_when_there_is_no_such_camera_is_refused() -> None:
    answer, _ = query_plan(SetAccuracyRequest(2, "Rear", None, None), has_camera=False)
    assert isinstance(answer, Error)
    assert "no omnidirectional camera 'Rear'" in answer.reason


def test_plan_when_a_negative_budget_is_asked_is_refused_before_anything_is_turned() -> None:
    answer, posted = query_plan(SetAccuracyRequest(3, "", None, -1.0))
    assert answer == Error(3, "budget_ms must be 0 (not asked) or more, not -1.0")
    assert posted == []
