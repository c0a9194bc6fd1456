"""The stream's answer to how a robot's camera is drawn, after its dial was turned if that is asked.

The simulation knows the camera, the drawing thread how it draws it: the question goes through both.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from catoptra_protocol.errors import DomainError
from catoptra_protocol.stream.replies import Error, PlanAlternative, PlanReply, Reply
from catoptra_protocol.stream.requests import SetAccuracyRequest
from catoptra_server.frames.frame_request import OmniCameraSpec
from catoptra_server.frames.render_thread import PlanCallback
from catoptra_server.frames.view_cache import ViewState
from catoptra_server.planning.planner import PlanOption
from catoptra_server.robot.render_settings import AccuracyTarget
from catoptra_server.simulation import AccuracyTargetChanged, Client, SimulationEvent

# Hands over an eye; the second is called, by any thread, with how it is drawn.
QueryPlan = Callable[[OmniCameraSpec, PlanCallback], None]


def handle_plan_request(
    request: SetAccuracyRequest,
    client: Client,
    *,
    send_reply: Callable[[Reply], None],
    post: Callable[[SimulationEvent], None],
    query_plan: QueryPlan,
) -> None:
    """Answer once the simulation has turned the dial and the drawing thread has planned."""
    try:
        AccuracyTarget().with_changes(
            max_error_px=request.max_error_px, budget_ms=request.budget_ms
        )
    except DomainError as error:
        send_reply(Error(request.id, str(error)))
        return
    loop = asyncio.get_running_loop()

    def query_camera_plan(eye: OmniCameraSpec | None, name: str) -> None:
        def reply(state: ViewState | None) -> None:
            loop.call_soon_threadsafe(send_reply, _plan_reply(request.id, name, eye, state))

        if eye is None:
            reply(None)
        else:
            query_plan(eye, reply)

    post(
        AccuracyTargetChanged(
            client, request.camera, request.max_error_px, request.budget_ms, query_camera_plan
        )
    )


def _plan_reply(id_: int, name: str, eye: OmniCameraSpec | None, state: ViewState | None) -> Reply:
    if eye is None or state is None:
        return Error(
            id_, f"your robot has no omnidirectional camera {name[:80]!r}, or is not there"
        )
    choice, dial = state.choice, eye.render_settings.accuracy_target
    return PlanReply(
        id=id_,
        camera=name,
        max_error_px=dial.max_error_px,
        budget_ms=dial.budget_ms,
        plan=str(choice.plan),
        target_met=choice.target_met,
        error_bound_px=choice.bound.outline_error_px if choice.bound else None,
        error_bounds=choice.bound.as_dict() if choice.bound else None,
        cost_ms=choice.predicted_ms,
        median_frame_ms=state.median_ms,
        more_accurate=_plan_alternative(choice.more_accurate),
        faster=_plan_alternative(choice.faster),
    )


def _plan_alternative(option: PlanOption | None) -> PlanAlternative | None:
    return (
        PlanAlternative(option.plan.description, option.error_bound_px, option.predicted_ms)
        if option
        else None
    )
