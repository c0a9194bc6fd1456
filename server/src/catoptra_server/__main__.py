"""The first word of the command line: `doctor` and `explain` examine; without one, it serves.

Nothing else is imported before the word is read, so that the doctor speaks where the server's own
libraries cannot be loaded. To add a command, write its `main` and add its case.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

EXIT_USAGE = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; return its exit status."""
    # NumPy's BLAS threads would spin beside the renderer's; set before NumPy is loaded.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    words = sys.argv[1:] if arguments is None else [*arguments]
    match words:
        case ["doctor", *rest]:
            from catoptra_server.doctor.doctor_cli import main as examine

            return examine(rest)
        case ["cost", *_]:
            print("catoptra-server: the cost study is `catoptra-studies cost`", file=sys.stderr)
            return EXIT_USAGE
        case ["explain", *rest]:
            from catoptra_server.explain import main as explain

            return explain(rest)
        case _:
            from catoptra_server.cli import main as serve

            return serve(words)


if __name__ == "__main__":
    sys.exit(main())
