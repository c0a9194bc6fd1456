"""Entry point of `catoptra-server`: the server, or another command.

No module with libraries is imported before the command is known: the doctor runs where the server's
libraries cannot be loaded, and signals end the process already while modules are loaded. To add
a command, write a `main`, a case and a line of `commands.COMMANDS`.
"""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Callable, Sequence
from functools import partial

from catoptra_protocol.interrupts import end_at_interrupt

# As typing's, which takes longer to load than all else here.
TYPE_CHECKING = False
if TYPE_CHECKING:
    from catoptra_server.runtime.faults import Termination


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command, and return the exit status of the process."""
    # NumPy's BLAS threads would spin beside the renderer's; set before NumPy is loaded.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with end_at_interrupt("catoptra-server"):
        from catoptra_protocol.command_line import run_program
        from catoptra_server.commands import COMMANDS
        from catoptra_server.runtime.faults import Termination
    termination = Termination()
    load = partial(_load_command, termination)
    with termination.handle_signals():
        status = run_program("catoptra-server", COMMANDS, load, arguments, default="serve")
    return termination.status or status


def _load_command(termination: Termination, name: str) -> Callable[[Sequence[str]], int]:
    # Matched by hand: argparse's subparsers would import every command for the options.
    match name:
        case "doctor":
            from catoptra_server.commands.doctor.command import main as doctor

            return doctor
        case "explain":
            from catoptra_server.commands.explain import main as explain

            return explain
        case "calibration":
            from catoptra_server.commands.calibration import main as write_calibration

            return write_calibration
        case "dataset":
            from catoptra_server.datasets.dataset_command import main as draw_dataset

            return partial(draw_dataset, termination=termination)
        case "import":
            from catoptra_server.commands.import_world import main as import_world

            return import_world
        case "map":
            from catoptra_server.commands.draw_map import main as draw_map

            return draw_map
        case "list":
            from catoptra_server.commands.list import main as list_names

            return list_names
        case _:
            # Modules and world live as long as the process: collections during the start find
            # nothing, and take 5 ms. `server.py` enables them once the ports listen.
            gc.disable()
            from catoptra_server.commands.serve import main as serve

            return partial(serve, termination=termination)


if __name__ == "__main__":
    sys.exit(main())
