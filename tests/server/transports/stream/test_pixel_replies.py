"""Replies about points of an image, once the simulation has cast the ray."""

from __future__ import annotations

import asyncio
import threading

import pytest

from catoptra_protocol.stream.replies import Error, PixelReply, Reply
from catoptra_protocol.stream.requests import GetPixelRequest
from catoptra_server.frames.frame import CameraChannel
from catoptra_server.serve.stream.replies import request_pixel
from catoptra_server.serve.stream.session import PendingRequests, RobotSession
from catoptra_server.simulation import Fault, PixelRequested, SimulationEvent
from catoptra_server.simulation.sight import OUTSIDE, PixelView
from helpers.loopback import run_scenario


async def query_pixel(view: PixelView | Fault | None) -> Reply:
    """Reply to a request, with this result of the simulation's thread at 1.5 s."""
    replies: asyncio.Queue[Reply] = asyncio.Queue()

    def post(event: SimulationEvent) -> bool:
        assert isinstance(event, PixelRequested)
        assert (event.channel, event.point_px) == (CameraChannel("A", "Omni"), (3.5, 4.5))
        thread = threading.Thread(target=event.reply, args=(1.5, view))
        thread.start()
        thread.join()
        return True

    session = RobotSession(post, on_fault=print)
    pending = PendingRequests(replies.put_nowait)
    request = GetPixelRequest(7, "A", "Omni", 3.5, 4.5)
    request_pixel(request, pending.add(request.id), session)
    return await replies.get()


@pytest.mark.parametrize(
    ("view", "expected"),
    [
        (
            PixelView(1.0, 2.0, 3.0, "wall", 0.5),
            PixelReply(7, 1.5, 1.0, 2.0, 3.0, "wall", 0.5),
        ),
        (OUTSIDE, PixelReply(7, 1.5, None, None, None, "", None)),
        (Fault("broken"), Error(7, "broken")),
        (None, Error(7, "there is no camera 'Omni' of robot 'A'")),
    ],
)
def test_reply_is_that_of_the_simulation(view: PixelView | Fault | None, expected: Reply) -> None:
    async def scenario() -> None:
        assert await query_pixel(view) == expected

    run_scenario(scenario())
