"""A stream server without a simulation: a camera that draws when asked, and a record of posts."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

import numpy as np

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.wire.stream_answers import StartRecord
from catoptra_server.effects.decide import Decision
from catoptra_server.imaging.frame import Frame
from catoptra_server.imaging.shot import SCREEN, CameraChannel, Caption, Channel
from catoptra_server.mailbox import Mailboxes
from catoptra_server.simulation import Drawn, FrameWanted, Request
from catoptra_server.transports.zmq_stream import StreamServer, serve_stream
from catoptra_server.transports.zmq_stream_facts import CameraFacts, StreamFacts
from helpers.loopback import HOST
from helpers.robots import FakeViews
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
    """Counts what is drawn, keeps what is posted. Every byte of a picture is the frame's number.

    draws: whether a wanted frame ever comes.
    """

    width: int = 8
    height: int = 6
    draws: bool = True
    drawn: int = 0
    posted: list[Request] = field(default_factory=list)
    mailboxes: Mailboxes | None = None

    def post(self, request: Request) -> None:
        """Draw at once what is wanted; keep what else is posted."""
        match request:
            case FrameWanted(channel=channel):
                if self.draws:
                    self._draw(channel)
            case Drawn():
                pass
            case _:
                self.posted.append(request)

    def _draw(self, channel: Channel) -> None:
        assert self.mailboxes is not None
        known = {CameraChannel(r, c) for r in ("", "OmniP2AT") for c in ("", "Omni")}
        if channel not in {SCREEN, *known}:
            self.mailboxes.refuse(channel)
            return
        self.drawn += 1
        pose = Pose.from_rpy((0.01 * self.drawn, 0.0, -0.2))
        frame = Frame(
            sequence=self.drawn,
            time_s=0.1 * self.drawn,
            rgb=np.full((self.height, self.width, 3), self.drawn % 256, dtype=np.uint8),
            exposed_s=0.0,
            finished_s=0.0,
            channel=channel,
            caption=Caption(
                *("OmniP2AT", "USARBot.OmniP2AT", "Omni", pose, MOUNT, tuple(LAW.items()))
            ),
            stage_ms={"trace": 2.0},
            plan="traced",
            effects=(Decision("Bloom", False, 0.0, 0.5, "grey levels", "dim"),),
        )
        self.mailboxes.put(frame)


@asynccontextmanager
async def streaming(scene: Scene) -> AsyncIterator[StreamServer]:
    """Serve a scene on a free port."""
    scene.mailboxes = Mailboxes(scene.post, ahead=False)
    async with serve_stream(
        HOST,
        0,
        mailboxes=scene.mailboxes,
        post=scene.post,
        facts=FACTS,
        plan_of=lambda eye, tell: tell(FakeViews().choice(eye)),
    ) as server:
        yield server
