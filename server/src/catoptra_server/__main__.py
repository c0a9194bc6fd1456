"""Entry point of `catoptra-server`: the server, or one of its subcommands `doctor` and `explain`.

No module with libraries is imported before the subcommand is known: the doctor runs where the
server's libraries cannot be loaded, and signals end the server already while they are loaded. To
add a subcommand, write its `main` and a case.
"""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Sequence

from catoptra_server.termination import Termination

EXIT_USAGE = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a subcommand, and return the exit status of the process."""
    # NumPy's BLAS threads would spin beside the renderer's; set before NumPy is loaded.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Matched by hand: argparse's subparsers would import every subcommand for its options.
    words = sys.argv[1:] if arguments is None else [*arguments]
    match words:
        case ["doctor", *rest]:
            from catoptra_server.doctor.doctor_cli import main as doctor

            return doctor(rest)
        case ["cost", *_]:
            print("catoptra-server: the cost study is `catoptra-studies cost`", file=sys.stderr)
            return EXIT_USAGE
        case ["explain", *rest]:
            from catoptra_server.explain import main as explain

            return explain(rest)
        case _:
            return _serve(words)


def _serve(words: Sequence[str]) -> int:
    termination = Termination()
    with termination.handle_signals():
        # Modules live as long as the process: collections while they are loaded find nothing.
        gc.disable()
        from catoptra_server.cli import main as serve

        gc.freeze()
        gc.enable()
        return serve(words, termination)


if __name__ == "__main__":
    sys.exit(main())
