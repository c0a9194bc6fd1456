"""A stream server without a simulation: frames rendered on request, and a record of events."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field

import numpy as np

from catoptra_protocol.landmarks import Landmark
from catoptra_protocol.optics.transforms import Pose
from catoptra_protocol.stream.replies import StartPoseRecord
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.frames.frame import (
    IMAGE_PORT,
    CameraChannel,
    Channel,
    Frame,
    FrameMetadata,
    FrameRendered,
    FrameRequested,
)
from catoptra_server.frames.mailbox import Mailboxes
from catoptra_server.serve.port import ConnectionLimits, create_listener
from catoptra_server.serve.stream.peer import StreamServer, serve_stream
from catoptra_server.serve.stream.replies import CameraInfo, ServerInfo, StreamContext
from catoptra_server.simulation.events import SimulationEvent
from helpers.loopback import HOST
from helpers.robots import FakeViewProvider, make_p2at
from helpers.stream_messages import CAMERA_MODEL

MOUNT = Pose.from_rpy((0.1, 0.0, -0.5))
LANDMARK = Landmark("a", "beacon", 1.0, 2.0, 0.1, 0.0, 0.2, 0.4, "cyan", "yellow")
SERVER_INFO = ServerInfo(
    server="Catoptra test",
    world="field",
    robots=(make_p2at(),),
    clock="lockstep",
    cameras={
        ("USARBot.OmniP2AT", "Omni"): CameraInfo(tuple(CAMERA_MODEL.items()), MOUNT, "traced")
    },
    landmarks=(LANDMARK,),
    start_poses=(StartPoseRecord("Centre", (1.0, 2.0, 3.0), (0.0, 0.0, 0.5)),),
)


@dataclass
class FakeSimulation:
    """Renders requested frames and records all other events.

    Every byte of an image is the number of its frame.
    """

    width: int = 8
    height: int = 6
    renders_frames: bool = True
    """Whether a requested frame ever arrives."""
    has_room: bool = True
    """Whether the queue of a client accepts more events."""
    num_rendered: int = 0
    """Frames rendered so far."""
    posted_events: list[SimulationEvent] = field(default_factory=list)
    mailboxes: Mailboxes | None = None

    def post(self, event: SimulationEvent) -> bool:
        """Render a requested frame at once; record any other event."""
        match event:
            case FrameRequested(channel=channel):
                if self.renders_frames:
                    self._render(channel)
            case FrameRendered():
                pass
            case _:
                self.posted_events.append(event)
        return self.has_room

    def _render(self, channel: Channel) -> None:
        assert self.mailboxes is not None
        known = {CameraChannel(r, c) for r in ("", "OmniP2AT") for c in ("", "omni")}
        if channel not in {IMAGE_PORT, *known}:
            self.mailboxes.fail(channel, "")
            return
        self.num_rendered += 1
        pose = Pose.from_rpy((0.01 * self.num_rendered, 0.0, -0.2))
        frame = Frame(
            sequence=self.num_rendered,
            time_s=0.1 * self.num_rendered,
            rgb=np.full((self.height, self.width, 3), self.num_rendered % 256, dtype=np.uint8),
            exposed_at_s=0.0,
            finished_at_s=0.0,
            channel=channel,
            metadata=FrameMetadata(
                *("OmniP2AT", "USARBot.OmniP2AT", "Omni", pose, MOUNT, tuple(CAMERA_MODEL.items()))
            ),
            stage_ms={"trace": 2.0},
            plan="traced",
            effect_decisions=(EffectDecision("Blooming", False, 0.0, 0.5, "dim"),),
        )
        self.mailboxes.put(frame)


def create_fake_context(simulation: FakeSimulation) -> StreamContext:
    """What the clients of a fake simulation share; sets its mailboxes."""
    simulation.mailboxes = Mailboxes(simulation.post, prefetch=False)
    return StreamContext(
        mailboxes=simulation.mailboxes,
        post=simulation.post,
        server_info=SERVER_INFO,
        query_plan=lambda _, view, reply: reply(FakeViewProvider().view_state(view)),
    )


@asynccontextmanager
async def serve_fake_simulation(
    simulation: FakeSimulation, *, limits: ConnectionLimits | None = None
) -> AsyncIterator[StreamServer]:
    """Serve a fake simulation on a free port."""
    async with serve_stream(
        create_listener(HOST, 0, name="stream"),
        create_fake_context(simulation),
        limits=limits or ConnectionLimits(),
    ) as server:
        yield server
