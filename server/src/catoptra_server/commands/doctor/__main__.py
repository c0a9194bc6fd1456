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


def _main() -> int:
    """Print the result; exit status 1 with the reason on stderr if the check could not run."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        print(json.dumps(_run_check(*sys.argv[1:])))
    except (CatoptraError, OSError, ImportError) as error:
        print(f"{error}", file=sys.stderr)
        return 1
    return 0


def _run_check(check: str, *arguments: str) -> dict[str, Any]:
    """Run one check; its result as JSON can carry it.

    Args:
        check: `egl-devices`, `self-test` or `configurations`.
        arguments: the renderer of the self-test; for configurations the number of robot files, the
            robot files, the world files.
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

            num_robots, files = int(arguments[0]), [Path(word) for word in arguments[1:]]
            found = check_configurations(files[:num_robots], files[num_robots:])
            return {"findings": [finding.to_json() for finding in found]}
    raise SystemExit(f"no check is named {check!r}")


if __name__ == "__main__":
    sys.exit(_main())
