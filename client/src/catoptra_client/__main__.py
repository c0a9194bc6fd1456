"""Entry point of `catoptra-client`, which loads the libraries of a command once that is known."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from catoptra_protocol.command_line import Command, run_program

COMMANDS = {
    "snapshot": "save one frame of a robot's camera as an image file",
    "calibration": "write a camera as calibration files of other programs",
    "train": "train the colour classifier from labelled frames",
    "bearings": "print the landmarks in the robot's frames",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command, and return the exit status of the process."""
    return run_program("catoptra-client", COMMANDS, _load_command, arguments)


def _load_command(name: str) -> Command:
    # NumPy and OpenCV take most of a second.
    from catoptra_client import cli

    return cli.COMMANDS[name]


if __name__ == "__main__":
    sys.exit(main())
