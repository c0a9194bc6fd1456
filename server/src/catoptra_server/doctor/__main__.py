"""`python -m catoptra_server.doctor QUESTION`: one question answered in JSON, in its own process.

For `children.ask` alone; people ask `catoptra-server doctor`.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

from catoptra_protocol.errors import CatoptraError


def run_check(check: str, arguments: list[str]) -> dict[str, Any]:
    """Return the facts. What a question needs is imported only when it is asked."""
    match check:
        case "egl-devices":
            from catoptra_server.doctor.egl_devices import list_egl_devices

            return {"devices": list_egl_devices()}
        case "self-test":
            from catoptra_server.doctor.self_test import run_self_test

            return run_self_test(arguments[0])
        case "configurations":
            from catoptra_server.doctor.configuration_files import check_configurations

            robots = [Path(w) for w in arguments[1 : 1 + int(arguments[0])]]
            worlds = [Path(w) for w in arguments[1 + int(arguments[0]) :]]
            return {"findings": [found.as_dict() for found in check_configurations(robots, worlds)]}
    raise SystemExit(f"no question {check!r}")


def main() -> int:
    """Answer on stdout; return 1 after saying on stderr what kept us from it."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        facts = run_check(sys.argv[1], sys.argv[2:])
    except (CatoptraError, OSError, ImportError) as error:
        print(f"{error}", file=sys.stderr)
        return 1
    print(json.dumps(facts))
    return 0


if __name__ == "__main__":
    sys.exit(main())
