"""The stream's answer to how a robot's camera is drawn, after its dial was turned if that is asked.

The simulation knows the camera, the drawing thread how it draws it: the question goes through both.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable

from catoptra_protocol.errors import DomainError
from catoptra_protocol.wire.stream_answers import Answer, PlanIs, PlanStep, Refused
from catoptra_protocol.wire.stream_requests import AskPlan
from catoptra_server.imaging.drawing import Told
from catoptra_server.imaging.shot import OmniEye
from catoptra_server.imaging.views import ViewState
from catoptra_server.plan.planner import Option
from catoptra_server.robot.render_wish import Dial
from catoptra_server.simulation import Client, DialTurned, Request

# Hands over an eye; the second is called, by any thread, with how it is drawn.
PlanOf = Callable[[OmniEye, Told], None]


def answer_plan(
    request: AskPlan,
    client: Client,
    *,
    answer: Callable[[Answer], None],
    post: Callable[[Request], None],
    plan_of: PlanOf,
) -> None:
    """Answer once the simulation has turned the dial and the drawing thread has planned."""
    try:
        Dial().turned(max_error_px=request.max_error_px, budget_ms=request.budget_ms)
    except DomainError as error:
        answer(Refused(request.id, str(error)))
        return
    loop = asyncio.get_running_loop()

    def found(eye: OmniEye | None, name: str) -> None:
        def told(state: ViewState | None) -> None:
            loop.call_soon_threadsafe(answer, _answer(request.id, name, eye, state))

        if eye is None:
            told(None)
        else:
            plan_of(eye, told)

    post(DialTurned(client, request.camera, request.max_error_px, request.budget_ms, found))


def _answer(id_: int, name: str, eye: OmniEye | None, state: ViewState | None) -> Answer:
    if eye is None or state is None:
        return Refused(
            id_, f"your robot has no omnidirectional camera {name[:80]!r}, or is not there"
        )
    choice, dial = state.choice, eye.wish.dial
    return PlanIs(
        id=id_,
        camera=name,
        max_error_px=dial.max_error_px,
        budget_ms=dial.budget_ms,
        plan=str(choice.plan),
        keeps_word=choice.keeps_word,
        error_px=choice.bound.outline_px if choice.bound else None,
        bound=choice.bound.as_dict() if choice.bound else None,
        cost_ms=choice.ms,
        median_ms=state.median_ms,
        better=_step(choice.better),
        cheaper=_step(choice.cheaper),
    )


def _step(option: Option | None) -> PlanStep | None:
    return PlanStep(option.plan.numbers, option.error_px, option.ms) if option else None
