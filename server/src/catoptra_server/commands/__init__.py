"""The commands of `catoptra-server`: to serve, and to explain, list, export and check."""

from __future__ import annotations

from collections.abc import Mapping

COMMANDS: Mapping[str, str] = {
    "serve": "simulate robots in a world; also without the word",
    "explain": "report the effects that a robot's camera needs in a world, with their cost",
    "doctor": "check whether the server can run on this machine",
    "calibration": "write a robot's camera as calibration files of other programs",
    "dataset": "draw pictures with ground truth by a recipe, in shards",
    "import": "write a world of Gazebo (SDF) as a world file",
    "map": "draw a world from above: starts, landmarks, obstacles, free floor",
    "list": "list robots, worlds, cameras, landmarks, recipes and classes",
}
"""Commands and their help."""
