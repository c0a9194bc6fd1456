"""The command `catoptra-studies`: demo, seeds, ramps, live, cost, effects, and more.

Each subcommand has a module with a `main`, imported here once the name has been read. So
`demo` starts where no server is installed, and `figures` where no client can connect. To add a
study, write a command module and add one case to `_load_command` and one line to `COMMANDS`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence

from catoptra_protocol.interrupts import end_at_interrupt

COMMANDS = {
    "demo": "repeat the paper's experiment in both set-ups and write its report",
    "seeds": "evaluate the claims of demo with many seeds, without pictures",
    "ramps": "measure what the tilt of a robot on slopes does to bearings and filters",
    "live": "show a robot that drives and localizes itself in a browser, in real time",
    "cost": "measure what accuracy costs in time and gains in localization",
    "effects": "show each image effect, and the levels at which classification fails",
    "real": "compare photographs through a real camera with pictures of their twins",
    "cameras": "draw a gallery of all camera models in one world",
    "compare": "compare cameras for a task: resolution, blind zone, localization, cost",
    "figures": "draw the figures of the camera: faces, cube, mirrors, comparisons",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one study.

    Args:
        arguments: Words of the command line without the program's name; None reads sys.argv.

    Returns:
        The exit status of the process.
    """
    # Idle BLAS threads spin and nearly double a traced frame on two cores. NumPy reads the
    # variable on import, so no import of a study may come before this line.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with end_at_interrupt("catoptra-studies"):
        from catoptra_protocol.command_line import EXIT_FAILURE, run_program
    try:
        return run_program("catoptra-studies", COMMANDS, _load_command, arguments)
    except ModuleNotFoundError as error:
        # Any other missing module is a broken installation and deserves a traceback.
        if (error.name or "").partition(".")[0] != "catoptra_server":
            raise
        print(
            "catoptra-studies: this study renders with the server's own code, which is not "
            "installed: pip install 'catoptra-studies[server]'",
            file=sys.stderr,
        )
        return EXIT_FAILURE


def _load_command(name: str) -> Callable[[Sequence[str]], int]:
    match name:
        case "demo":
            from catoptra_studies.experiment.demo_command import main as run_demo

            return run_demo
        case "seeds":
            from catoptra_studies.experiment.seeds_command import main as run_seeds

            return run_seeds
        case "ramps":
            from catoptra_studies.experiment.ramps_command import main as run_ramps

            return run_ramps
        case "live":
            from catoptra_studies.live.live_command import main as run_live

            return run_live
        case "cost":
            from catoptra_studies.accuracy_cost.cost_command import main as run_cost

            return run_cost
        case "effects":
            from catoptra_studies.effects.effects_command import main as run_effects

            return run_effects
        case "real":
            from catoptra_studies.real.real_command import main as run_real

            return run_real
        case "cameras":
            from catoptra_studies.cameras.cameras_command import main as draw_cameras

            return draw_cameras
        case "compare":
            from catoptra_studies.cameras.compare_command import main as run_compare

            return run_compare
        case _:
            from catoptra_studies.camera_figures.figures_command import main as run_figures

            return run_figures
