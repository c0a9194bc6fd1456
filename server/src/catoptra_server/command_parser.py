"""Parser of a command line whose errors are one line each and a pointer to the help."""

from __future__ import annotations

import argparse
import sys
from typing import NoReturn

EXIT_USAGE = 2


class CommandParser(argparse.ArgumentParser):
    """argparse without the list of all options in front of every error."""

    def error(self, message: str) -> NoReturn:
        """End the process with status 2 and a message of two lines."""
        print(f"{self.prog}: {message}\n`{self.prog} --help` lists the options", file=sys.stderr)
        raise SystemExit(EXIT_USAGE)
