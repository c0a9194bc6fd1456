"""Entry point of `catoptra-server`: the server, or another command.

No module with libraries is imported before the command is known: the doctor runs where the server's
libraries cannot be loaded, and signals end the process already while modules are loaded. To add
a command, write a `main`, a case and a line of COMMANDS.
"""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Mapping, Sequence

from catoptra_server.runtime.faults import Termination

_EXIT_USAGE = 2
COMMANDS: Mapping[str, str] = {
    "explain": "report the effects that a robot's camera needs in a world, with their cost",
    "doctor": "check whether the server can run on this machine",
    "calibration": "write a robot's camera as calibration files of other programs",
    "dataset": "draw pictures with ground truth by a recipe, in shards",
    "import": "write a world of Gazebo (SDF) as a world file",
    "map": "draw a world from above: starts, landmarks, obstacles, free floor",
    "list": "list robots, worlds, landmarks and classes",
}
"""Commands and their help; the server itself has none."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command, and return the exit status of the process."""
    # NumPy's BLAS threads would spin beside the renderer's; set before NumPy is loaded.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    words = sys.argv[1:] if arguments is None else [*arguments]
    termination = Termination()
    with termination.handle_signals():
        status = _run(words, termination)
    return termination.status or status


def _run(words: Sequence[str], termination: Termination) -> int:
    # Matched by hand: argparse's subparsers would import every command for the options.
    match words:
        case ["doctor", *rest]:
            from catoptra_server.commands.doctor.command import main as doctor

            return doctor(rest)
        case ["explain", *rest]:
            from catoptra_server.commands.explain import main as explain

            return explain(rest)
        case ["calibration", *rest]:
            from catoptra_server.commands.calibration import main as write_calibration

            return write_calibration(rest)
        case ["dataset", *rest]:
            from catoptra_server.datasets.dataset_command import main as draw_dataset

            return draw_dataset(rest, termination)
        case ["import", *rest]:
            from catoptra_server.commands.import_world import main as import_world

            return import_world(rest)
        case ["map", *rest]:
            from catoptra_server.commands.draw_map import main as draw_map

            return draw_map(rest)
        case ["list", *rest]:
            from catoptra_server.commands.list import main as list_names

            return list_names(rest)
        case ["--version", *_]:
            from catoptra_server.commands.list import describe_version

            print(describe_version())
            return 0
        case [word, *_] if not word.startswith("-"):
            print(f"catoptra-server: {_describe_unknown(word)}", file=sys.stderr)
            return _EXIT_USAGE
        case _:
            return _serve(words, termination)


def _describe_unknown(word: str) -> str:
    """Message for a word that is no command."""
    if word == "cost":
        return "the cost study is `catoptra-studies cost`"
    if word == "serve":
        return "to serve needs no command: catoptra-server --robot FILE --world FILE"
    from difflib import get_close_matches  # takes 10 ms to load

    close = get_close_matches(word, COMMANDS, n=1)
    hint = f"; did you mean {close[0]}?" if close else ""
    return f"no command {word!r}: the commands are {', '.join(COMMANDS)}{hint}"


def _serve(words: Sequence[str], termination: Termination) -> int:
    # Modules and world live as long as the process: collections during the start find nothing, and
    # take 5 ms. `server.py` enables them once the ports listen.
    gc.disable()
    from catoptra_server.commands.serve import main as serve

    return serve(words, termination)


if __name__ == "__main__":
    sys.exit(main())
