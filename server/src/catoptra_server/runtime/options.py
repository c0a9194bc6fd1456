"""Command lines: readers of options' values, and a parser with short errors.

Each reader returns a value, or raises ArgumentTypeError with the expected form. argparse shows that
text as the message; for a ValueError it would show the name of the function. An error of the parser
is one line and a pointer to the help. The doctor imports this module: it loads no library.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Callable
from functools import partial
from typing import NoReturn

_EXIT_USAGE = 2


class CommandParser(argparse.ArgumentParser):
    """argparse without the list of all options in front of every error."""

    def error(self, message: str) -> NoReturn:
        """End the process with status 2 and a message of two lines."""
        print(f"{self.prog}: {message}\n`{self.prog} --help` lists the options", file=sys.stderr)
        raise SystemExit(_EXIT_USAGE)


def int_within(name: str, first: int, last: int) -> Callable[[str], int]:
    """Reader of an integer option within two limits, both included."""

    def parse(text: str) -> int:
        try:
            value = int(text)
        except ValueError:
            _reject(f"{name} is an integer from {first} to {last}, not {text!r}")
        if not first <= value <= last:
            _reject(f"{name} is {first} to {last}, not {value}")
        return value

    return parse


# More than a thousand threads is a typing error that the renderer would obey.
_MAX_THREADS = 1024

parse_port = int_within("a port", 0, 65535)
parse_threads = int_within("a number of threads", 0, _MAX_THREADS)


def parse_float_within(text: str, *, name: str, last: float = math.inf, unit: str = "") -> float:
    """Finite number of an option, from 0 to a limit."""
    limits = "0 or more" if math.isinf(last) else f"0 to {last:g}"
    expected = f"{name} is {limits}{unit and ' ' + unit}, not {text!r}"
    try:
        value = float(text)
    except ValueError:
        _reject(expected)
    # The comparison is false for NaN, which float() accepts.
    if not 0.0 <= value <= last or math.isinf(value):
        _reject(expected)
    return value


parse_non_negative = partial(parse_float_within, name="a tolerance or a budget")


def parse_integer(text: str) -> int:
    """Any integer, such as a seed."""
    try:
        return int(text)
    except ValueError:
        _reject(f"a seed is an integer, not {text!r}")


_MULTI_VIEW = re.compile(r"(\d+)x(\d+):(\d+)x(\d+)", re.ASCII)


def parse_tiles(text: str) -> tuple[int, int, int, int]:
    """Columns, rows, width and height of a multi-view, such as 2x2:320x240."""
    match = _MULTI_VIEW.fullmatch(text)
    if match is None:
        _reject(f"a multi-view has the form 2x2:320x240, not {text!r}")
    columns, rows, width_px, height_px = map(int, match.groups())
    return columns, rows, width_px, height_px


def _reject(message: str) -> NoReturn:
    raise argparse.ArgumentTypeError(message) from None
