"""A stream server without a simulation: a camera that draws when asked, and a record of posts."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

import numpy as np

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.wire.stream_answers import StartRecord
from catoptra_server.encode import Frame
from catoptra_server.mailbox import Mailbox
from catoptra_server.simulation import Request
from catoptra_server.transports.zmq_stream import StreamServer, serve_stream
from catoptra_server.transports.zmq_stream_facts import CameraFacts, StreamFacts
from helpers.loopback import HOST
from helpers.stream_messages import LAW

MOUNT = Pose.from_rpy((0.1, 0.0, -0.5))
LANDMARK = Landmark("a", "beacon", 1.0, 2.0, 0.1, 0.0, 0.2, 0.4, "cyan", "yellow")
FACTS = StreamFacts(
    server="Catoptra test",
    world="field",
    class_names=("USARBot.OmniP2AT",),
    clock="lockstep",
    cameras={("USARBot.OmniP2AT", "Omni"): CameraFacts(tuple(LAW.items()), MOUNT, "traced")},
    landmarks=(LANDMARK,),
    starts=(StartRecord("Centre", (1.0, 2.0, 3.0), (0.0, 0.0, 0.5)),),
)


@dataclass
class Scene:
    """Counts what is drawn, keeps what is posted. Every byte of a picture is the frame's number."""

    width: int = 8
    height: int = 6
    drawn: int = 0
    posted: list[Request] = field(default_factory=list)
    mailbox: Mailbox | None = None

    def ask(self, newer_than: int) -> None:
        """Draw at once."""
        self.drawn += 1
        rgb = np.full((self.height, self.width, 3), self.drawn % 256, dtype=np.uint8)
        pose = Pose.from_rpy((0.01 * self.drawn, 0.0, -0.2))
        frame = Frame(
            *(self.drawn, "Omni", 0.1 * self.drawn, pose, rgb, {"trace": 2.0}, 0.0, 0.0),
            robot="OmniP2AT",
            class_name="USARBot.OmniP2AT",
        )
        assert self.mailbox is not None
        self.mailbox.put(frame)


@asynccontextmanager
async def streaming(scene: Scene) -> AsyncIterator[StreamServer]:
    """Serve a scene on a free port."""
    scene.mailbox = Mailbox(scene.ask, ahead=False)
    async with serve_stream(
        HOST, 0, mailbox=scene.mailbox, post=scene.posted.append, facts=FACTS
    ) as server:
        yield server
