"""`python -m catoptra_server.commands.doctor CHECK`: one check in a process of its own, as JSON.

The child's side of `devices.py:run_in_subprocess`; the command for users is
`catoptra-server doctor`. Crashing questions run here: about libraries and drivers, or with
them loaded. So does the self-test of a renderer, by the plan's own bound.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

from catoptra_protocol.errors import CatoptraError


def run_check(check: str, arguments: list[str]) -> dict[str, Any]:
    """Run one check.

    Args:
        check: `egl-devices`, `self-test` or `configurations`.
        arguments: the renderer of the self-test; for configurations the number of robot files, the
            robot files, the world files.

    Returns:
        Values that JSON can carry.
    """
    # Imported in each case: a library that cannot be loaded fails one check only.
    match check:
        case "egl-devices":
            from catoptra_server.commands.doctor.devices import list_egl_devices

            return {"devices": list_egl_devices()}
        case "self-test":
            from catoptra_server.commands.doctor.self_test import run_self_test

            return run_self_test(arguments[0])
        case "configurations":
            from catoptra_server.commands.doctor.self_test import check_configurations

            robots = [Path(w) for w in arguments[1 : 1 + int(arguments[0])]]
            worlds = [Path(w) for w in arguments[1 + int(arguments[0]) :]]
            return {"findings": [found.to_json() for found in check_configurations(robots, worlds)]}
    raise SystemExit(f"no check is named {check!r}")


def main() -> int:
    """Print the result; exit status 1 with the reason on stderr if the check could not run."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        values = run_check(sys.argv[1], sys.argv[2:])
    except (CatoptraError, OSError, ImportError) as error:
        print(f"{error}", file=sys.stderr)
        return 1
    print(json.dumps(values))
    return 0


if __name__ == "__main__":
    sys.exit(main())
