"""The simulated world in motion: `loop` owns clock and thread, `fleet` the robots.

`spawned_robot` is one of them. Others post `requests`; nobody else touches it.
"""

from catoptra_server.simulation.fleet import Fleet
from catoptra_server.simulation.loop import ClockMode, Simulation
from catoptra_server.simulation.simulation_events import (
    AccuracyTargetChanged,
    Client,
    ClientDisconnected,
    CommandReceived,
    FrameRendered,
    FrameRequested,
    LandmarksRequested,
    SimulationEvent,
    StopRequested,
)

__all__ = [
    "CommandReceived",
    "Client",
    "ClockMode",
    "AccuracyTargetChanged",
    "FrameRendered",
    "Fleet",
    "FrameRequested",
    "LandmarksRequested",
    "ClientDisconnected",
    "SimulationEvent",
    "Simulation",
    "StopRequested",
]
