"""The question goes through the simulation and the drawing thread, and comes back as one answer."""

from __future__ import annotations

from catoptra_protocol.wire.stream import bytes_from_message
from catoptra_protocol.wire.stream_answers import Answer, PlanIs, Refused
from catoptra_protocol.wire.stream_requests import AskPlan, AskStatus
from catoptra_server.imaging.shot import OmniEye
from catoptra_server.robot.render_wish import Dial, RenderWish
from catoptra_server.simulation import DialTurned
from helpers.loopback import play
from helpers.robots import CAMERA
from helpers.stream_peer import raw_peer
from helpers.stream_scene import Scene, streaming


def asked(request: AskPlan, *, has_camera: bool = True) -> tuple[Answer, list[DialTurned]]:
    """Return the answer of a server whose simulation has, or has not, a camera; and its posts."""
    scene = Scene()
    answers: list[Answer] = []

    async def visit() -> None:
        async with streaming(scene) as server:
            with raw_peer(server.port) as peer:
                await peer.send(bytes_from_message(request))
                await peer.send(bytes_from_message(AskStatus(99)))
                answers.append((await peer.receive())[0])  # refused at once, or the status
                for turned in turned_in(scene):
                    dial = Dial().turned(
                        max_error_px=turned.max_error_px, budget_ms=turned.budget_ms
                    )
                    eye = OmniEye(CAMERA.camera, RenderWish(dial=dial))
                    turned.reply(eye if has_camera else None, turned.camera or "Omni")
                    answers.append((await peer.receive())[0])

    play(visit())
    return (answers[-1], turned_in(scene))


def turned_in(scene: Scene) -> list[DialTurned]:
    return [post for post in scene.posted if isinstance(post, DialTurned)]


def test_plan_when_a_tolerance_is_asked_tells_how_the_camera_is_drawn_by_it() -> None:
    answer, posted = asked(AskPlan(1, "", 0.5, None))
    assert isinstance(answer, PlanIs)
    assert (answer.id, answer.camera, answer.max_error_px, answer.budget_ms) == (1, "Omni", 0.5, 0)
    assert answer.bound is not None
    assert answer.error_px == answer.bound["outline_px"]
    assert (answer.median_ms, answer.cost_ms, answer.better) == (12.5, None, None)
    assert [(p.camera, p.max_error_px, p.budget_ms) for p in posted] == [("", 0.5, None)]


def test_plan_when_there_is_no_such_camera_is_refused() -> None:
    answer, _ = asked(AskPlan(2, "Rear", None, None), has_camera=False)
    assert isinstance(answer, Refused)
    assert "no omnidirectional camera 'Rear'" in answer.reason


def test_plan_when_a_negative_budget_is_asked_is_refused_before_anything_is_turned() -> None:
    answer, posted = asked(AskPlan(3, "", None, -1.0))
    assert answer == Refused(3, "budget_ms must be 0 (not asked) or more, not -1.0")
    assert posted == []
