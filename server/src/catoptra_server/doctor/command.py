"""`catoptra-server doctor`: examine this machine, print what was found, say it in the status."""

from __future__ import annotations

import argparse
from collections.abc import Sequence


def main(arguments: Sequence[str]) -> int:
    """Examine; return 0."""
    argparse.ArgumentParser(prog="catoptra-server doctor").parse_args(arguments)
    return 0
