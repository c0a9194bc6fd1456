"""Replies to accuracy requests: the rendering plan of a camera, under a new target if given.

The simulation holds the camera, the render thread its plan: a request passes through both. A newer
request of the client supersedes one that waits in either.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from functools import partial

from catoptra_protocol.errors import DomainError
from catoptra_protocol.stream.replies import Error, PlanAlternative, PlanReply, Reply
from catoptra_protocol.stream.requests import SetAccuracyRequest
from catoptra_server.frames.frame_plan import ViewState
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.plans import PlanOption
from catoptra_server.frames.render_thread import PlanCallback, PlanFailure
from catoptra_server.render.render_settings import AccuracyTarget
from catoptra_server.simulation import AccuracyTargetChanged, Fault
from catoptra_server.transports.stream.pending_requests import PendingRequest
from catoptra_server.transports.stream.robot_session import RobotSession

# Client, camera, and the callback with the camera's plan, called by any thread.
QueryPlan = Callable[[Hashable, OmniCameraSpec, PlanCallback], None]


def request_plan(
    request: SetAccuracyRequest,
    pending: PendingRequest,
    session: RobotSession,
    query_plan: QueryPlan,
) -> None:
    """Reply once the simulation has set the target and the render thread has planned.

    Args:
        request: Request of the client.
        pending: Receives the reply.
        session: Client of the simulation, with the robot.
        query_plan: Hands a camera to the render thread.
    """
    # Checked here and not in the simulation, so that a wrong number has its reply at once.
    try:
        AccuracyTarget().with_changes(
            max_error_px=request.max_error_px, budget_ms=request.budget_ms
        )
    except DomainError as error:
        pending.reject(str(error))
        return

    def query_camera_plan(camera: OmniCameraSpec | Fault | None, name: str) -> None:
        # `name` is that of the camera the simulation selected, since a request may leave it empty.
        if not isinstance(camera, OmniCameraSpec):
            pending.reply_from_thread(partial(_camera_error, request.id, name, camera))
            return
        make_reply = partial(_plan_reply, request.id, name, camera)
        query_plan(
            session, camera, lambda state: pending.reply_from_thread(partial(make_reply, state))
        )

    session.post(
        AccuracyTargetChanged(
            session, request.camera, request.max_error_px, request.budget_ms, query_camera_plan
        )
    )


def _camera_error(id_: int, name: str, fault: Fault | None) -> Error:
    if fault is not None:
        return Error(id_, fault.reason)
    return Error(id_, f"this client has no robot with an omnidirectional camera {name[:80]!r}")


def _plan_reply(
    id_: int, name: str, camera: OmniCameraSpec, state: ViewState | PlanFailure
) -> Reply:
    if isinstance(state, PlanFailure):
        return Error(id_, state.reason)
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
        more_accurate=plan_alternative(choice.more_accurate),
        faster=plan_alternative(choice.faster),
    )


def plan_alternative(option: PlanOption | None) -> PlanAlternative | None:
    """Record of a neighbour of a plan; None for none."""
    return (
        PlanAlternative(option.plan.description, option.error_bound_px, option.predicted_ms)
        if option
        else None
    )
