"""The simulated world in motion: `loop` owns clock and thread, `fleet` the robots.

Other threads post `events` and touch nothing else here.
"""

from catoptra_server.simulation.events import (
    AccuracyTargetChanged,
    Client,
    ClientDisconnected,
    CommandReceived,
    Fault,
    LandmarksRequested,
    NotePublished,
    PixelRequested,
    ResetRequested,
    SharedRobotDriven,
    SimulationEvent,
    StateRequested,
    StepRequested,
    StepResult,
    StopRequested,
)
from catoptra_server.simulation.fleet import Fleet
from catoptra_server.simulation.loop import ClockMode, Simulation

__all__ = [
    "AccuracyTargetChanged",
    "Client",
    "ClientDisconnected",
    "ClockMode",
    "CommandReceived",
    "Fault",
    "Fleet",
    "LandmarksRequested",
    "NotePublished",
    "PixelRequested",
    "ResetRequested",
    "SharedRobotDriven",
    "Simulation",
    "SimulationEvent",
    "StateRequested",
    "StepRequested",
    "StepResult",
    "StopRequested",
]
