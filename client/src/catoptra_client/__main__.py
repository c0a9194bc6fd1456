"""Entry point of `catoptra-client`, which loads the libraries of a command once that is known."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence

from catoptra_protocol.interrupts import end_at_interrupt

COMMANDS = {
    "snapshot": "save one frame of a robot's camera as an image file",
    "calibration": "write a camera as calibration files of other programs",
    "convert": "read a calibration file, and write it in the formats of other programs",
    "train": "train the colour classifier from labelled frames",
    "bearings": "print the landmarks in the robot's frames",
    "record": "record a robot as an MCAP file of ROS 2 messages",
    "ros2": "publish a robot's messages as topics of ROS 2, and drive it by /cmd_vel",
    "replay": "describe, serve, simulate or draw a recording again",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command, and return the exit status of the process."""
    with end_at_interrupt("catoptra-client"):
        from catoptra_protocol.command_line import run_program
    return run_program("catoptra-client", COMMANDS, _load_command, arguments)


def _load_command(name: str) -> Callable[[Sequence[str]], int]:
    # NumPy and OpenCV take most of a second.
    if name == "convert":
        from catoptra_client.conversion import convert

        return convert
    from catoptra_client import cli

    return cli.COMMANDS[name]


if __name__ == "__main__":
    sys.exit(main())
