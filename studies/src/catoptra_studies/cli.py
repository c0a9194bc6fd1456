"""The command `catoptra-studies`: demo, seeds, live, cost, effects, cameras, compare and figures.

Each subcommand has a module with a `main`, imported here once the name has been read. So
`demo` starts where no server is installed, and `figures` where no client can connect. To add a
study, write a command module and add one case to `_run` and one line to `_USAGE`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

EXIT_USAGE = 2
# As shells report a process that SIGINT ended.
_EXIT_INTERRUPTED = 130

_USAGE = """\
usage: catoptra-studies {demo,seeds,live,cost,effects,cameras,compare,figures} [options]

  demo      repeat the paper's experiment in both set-ups and write its report
  seeds     evaluate the claims of demo with many seeds, without pictures
  live      show a robot that drives and localizes itself in a browser, in real time
  cost      measure what accuracy costs in time and gains in localization
  effects   show each image effect, and the levels at which classification fails
  cameras   draw a gallery of all camera models in one world
  compare   compare cameras for a task: resolution, blind zone, localization, cost
  figures   draw the figures of the camera: faces, cube, mirrors, comparisons

`catoptra-studies COMMAND --help` lists the options of a command."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one study.

    Args:
        arguments: Words of the command line without the program's name; None reads sys.argv.

    Returns:
        The exit status of the subcommand: 0 after success, 2 for a wrong command line or for a
        study that needs the server where none is installed, 130 after Ctrl-C.
    """
    # Idle BLAS threads spin and nearly double a traced frame on two cores. NumPy reads the
    # variable on import, so no import of a study may come before this line.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    words = sys.argv[1:] if arguments is None else [*arguments]
    try:
        return _run(words)
    except KeyboardInterrupt:
        print("catoptra-studies: interrupted", file=sys.stderr)
        return _EXIT_INTERRUPTED
    except ModuleNotFoundError as error:
        # Any other missing module is a broken installation and deserves a traceback.
        if (error.name or "").partition(".")[0] != "catoptra_server":
            raise
        print(
            f"catoptra-studies {words[0]}: renders with the server's own code, which is not "
            "installed: pip install 'catoptra-studies[server]'",
            file=sys.stderr,
        )
        return EXIT_USAGE


def _run(words: Sequence[str]) -> int:
    match words:
        case ["demo", *rest]:
            from catoptra_studies.experiment.demo_command import main as run_demo

            return run_demo(rest)
        case ["seeds", *rest]:
            from catoptra_studies.experiment.seeds_command import main as run_seeds

            return run_seeds(rest)
        case ["live", *rest]:
            from catoptra_studies.live.live_command import main as run_live

            return run_live(rest)
        case ["cost", *rest]:
            from catoptra_studies.accuracy_cost.cost_command import main as run_cost

            return run_cost(rest)
        case ["effects", *rest]:
            from catoptra_studies.effects.effects_command import main as run_effects

            return run_effects(rest)
        case ["cameras", *rest]:
            from catoptra_studies.cameras.cameras_command import main as draw_cameras

            return draw_cameras(rest)
        case ["compare", *rest]:
            from catoptra_studies.cameras.compare_command import main as run_compare

            return run_compare(rest)
        case ["figures", *rest]:
            from catoptra_studies.camera_figures.figures_command import main as run_figures

            return run_figures(rest)
        case ["-h" | "--help", *_]:
            print(_USAGE)
            return 0
        case [word, *_] if not word.startswith("-"):
            print(f"catoptra-studies: no command {word!r}\n{_USAGE}", file=sys.stderr)
            return EXIT_USAGE
        case _:
            print(_USAGE, file=sys.stderr)
            return EXIT_USAGE
