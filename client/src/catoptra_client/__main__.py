"""Entry point of `catoptra-client`: Ctrl-C ends every command with one line, loading included."""

from __future__ import annotations

import sys
from collections.abc import Sequence

EXIT_INTERRUPTED = 130


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command, and return the exit status of the process."""
    try:
        # NumPy and OpenCV take most of a second, in which a user may have second thoughts.
        from catoptra_client.cli import main as run

        return run(arguments)
    except KeyboardInterrupt:
        print("catoptra-client: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
