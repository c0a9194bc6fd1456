"""The simulated world in motion: `loop` owns clock and thread, `fleet` the robots.

`spawned_robot` is one of them. Others post `requests`; nobody else touches it.
"""

from catoptra_server.simulation.fleet import Fleet
from catoptra_server.simulation.loop import Clock, Simulation
from catoptra_server.simulation.requests import (
    Asked,
    Client,
    DialTurned,
    Drawn,
    FrameWanted,
    LandmarksSought,
    Left,
    Request,
    Stop,
)

__all__ = [
    "Asked",
    "Client",
    "Clock",
    "DialTurned",
    "Drawn",
    "Fleet",
    "FrameWanted",
    "LandmarksSought",
    "Left",
    "Request",
    "Simulation",
    "Stop",
]
