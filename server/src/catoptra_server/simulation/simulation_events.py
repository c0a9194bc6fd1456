"""What may be asked of the simulation from any thread, and how it sees a control connection."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from catoptra_protocol.usarsim.commands import Command
from catoptra_protocol.usarsim.reports import Report
from catoptra_server.frames.frame_request import IMAGE_PORT, CameraChannel, Channel, OmniCameraSpec
from catoptra_server.simulation.landmark_visibility import LandmarkVisibility


class Client(Protocol):
    """One control connection as the simulation sees it. Both methods return at once."""

    def deliver(self, reports: Sequence[Report]) -> None:
        """Send reports, in order and together."""

    def reject_init(self) -> None:
        """Take note that INIT named no known class or start: there is no robot."""


@dataclass(frozen=True, slots=True)
class CommandReceived:
    """A client sent a command."""

    client: Client
    command: Command


@dataclass(frozen=True, slots=True)
class ClientDisconnected:
    """A client is gone, and with it its robot."""

    client: Client


@dataclass(frozen=True, slots=True)
class FrameRequested:
    """Somebody waits for a channel's frame with a larger sequence number; one drawn will do."""

    newer_than: float = math.inf
    channel: Channel = IMAGE_PORT


@dataclass(frozen=True, slots=True)
class FrameRendered:
    """A channel's shot has become a frame: the next one may be taken."""

    channel: Channel


@dataclass(frozen=True, slots=True)
class LandmarksRequested:
    """Somebody asks what a camera sees of the landmarks now.

    reply: told the time and the landmarks, None if there is no such camera; returns at once.
    """

    channel: CameraChannel
    reply: Callable[[float, tuple[LandmarkVisibility, ...] | None], None]


@dataclass(frozen=True, slots=True)
class AccuracyTargetChanged:
    """A client asks for another accuracy or time of its robot's camera; None = as it is.

    reply: told what is drawn from now on and the camera's name, None if there is no such camera;
    returns at once.
    """

    client: Client
    camera: str
    max_error_px: float | None
    budget_ms: float | None
    reply: Callable[[OmniCameraSpec | None, str], None]


@dataclass(frozen=True, slots=True)
class StopRequested:
    """End the simulation."""


SimulationEvent = (
    CommandReceived
    | ClientDisconnected
    | FrameRequested
    | FrameRendered
    | LandmarksRequested
    | AccuracyTargetChanged
    | StopRequested
)
