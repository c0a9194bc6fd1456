"""Replies to accuracy requests: the rendering plan of a camera, under a new target if given.

The simulation holds the camera, the render thread its plan: a request passes through both.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from catoptra_protocol.errors import DomainError
from catoptra_protocol.stream.replies import Error, PlanAlternative, PlanReply, Reply
from catoptra_protocol.stream.requests import SetAccuracyRequest
from catoptra_server.frames.render_thread import PlanCallback
from catoptra_server.frames.view_cache import ViewState
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.planning.plan_choice import PlanOption
from catoptra_server.robot.render_settings import AccuracyTarget
from catoptra_server.simulation import AccuracyTargetChanged, Client, SimulationEvent

# Camera, and the callback with its plan, called by any thread.
QueryPlan = Callable[[OmniCameraSpec, PlanCallback], None]


def handle_plan_request(
    request: SetAccuracyRequest,
    client: Client,
    *,
    send_reply: Callable[[Reply], None],
    post: Callable[[SimulationEvent], None],
    query_plan: QueryPlan,
) -> None:
    """Reply once the simulation has set the target and the render thread has planned.

    Args:
        request: Request of the client.
        client: Client with the robot.
        send_reply: Sends the reply; called on the loop.
        post: Hands an event to the simulation.
        query_plan: Hands a camera to the render thread.
    """
    # Checked here and not in the simulation, so that a wrong number has its reply at once.
    try:
        AccuracyTarget().with_changes(
            max_error_px=request.max_error_px, budget_ms=request.budget_ms
        )
    except DomainError as error:
        send_reply(Error(request.id, str(error)))
        return
    loop = asyncio.get_running_loop()

    def query_camera_plan(camera: OmniCameraSpec | None, name: str) -> None:
        def reply(state: ViewState | None) -> None:
            loop.call_soon_threadsafe(send_reply, _plan_reply(request.id, name, camera, state))

        # `name` is that of the camera the simulation selected, since a request may leave it empty.
        if camera is None:
            reply(None)
        else:
            query_plan(camera, reply)

    post(
        AccuracyTargetChanged(
            client, request.camera, request.max_error_px, request.budget_ms, query_camera_plan
        )
    )


def _plan_reply(
    id_: int, name: str, camera: OmniCameraSpec | None, state: ViewState | None
) -> Reply:
    if camera is None or state is None:
        reason = f"this client has no robot with an omnidirectional camera {name[:80]!r}"
        return Error(id_, reason)
    # The target as the simulation has it, not as requested: None in a request leaves a value
    # unchanged.
    choice, target = state.choice, camera.render_settings.accuracy_target
    return PlanReply(
        id=id_,
        camera=name,
        max_error_px=target.max_error_px,
        budget_ms=target.budget_ms,
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
