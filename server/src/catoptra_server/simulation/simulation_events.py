"""Events that other threads post to the simulation, and the control connection as the simulation
sees it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from catoptra_protocol.usarsim.commands import Command
from catoptra_protocol.usarsim.reports import Report
from catoptra_server.frames.frame_events import FrameRendered, FrameRequested
from catoptra_server.frames.frame_request import CameraChannel
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.simulation.landmark_visibility import LandmarkVisibility


class Client(Protocol):
    """One control connection. Methods return at once: the simulation does not wait for sockets."""

    def deliver(self, reports: Sequence[Report]) -> None:
        """Send reports, in order and in one piece."""

    def reject_init(self) -> None:
        """Record that INIT named an unknown class or start and spawned no robot."""


@dataclass(frozen=True, slots=True)
class CommandReceived:
    """A client sent a command."""

    client: Client
    command: Command


@dataclass(frozen=True, slots=True)
class ClientDisconnected:
    """A client disconnected; its robot is to be removed."""

    client: Client


# Replies by callback, not by future: the simulation has no event loop, and each transport has
# its own way back to its thread.
@dataclass(frozen=True, slots=True)
class LandmarksRequested:
    """A connection requests the landmarks in view of a camera."""

    channel: CameraChannel
    reply: Callable[[float, tuple[LandmarkVisibility, ...] | None], None]
    """Receives the simulation time and the landmarks, None without such a camera; returns at
    once."""


@dataclass(frozen=True, slots=True)
class AccuracyTargetChanged:
    """A client requests another accuracy target of its robot's camera, or the present one."""

    client: Client
    camera: str
    """Name of the camera in any case; empty for the robot's omnidirectional camera."""
    max_error_px: float | None
    """New tolerance; None leaves the present one."""
    budget_ms: float | None
    """New time budget of a frame; None leaves the present one."""
    reply: Callable[[OmniCameraSpec | None, str], None]
    """Receives the camera with the settings of the next frames, None without such a camera, and
    the camera's name; returns at once."""


@dataclass(frozen=True, slots=True)
class StopRequested:
    """The server shuts down."""


# To add an event: its class, its line here, and its case in `Simulation._handle`, which the type
# check demands.
SimulationEvent = (
    CommandReceived
    | ClientDisconnected
    | FrameRequested
    | FrameRendered
    | LandmarksRequested
    | AccuracyTargetChanged
    | StopRequested
)
