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


def answer(question: str, words: list[str]) -> dict[str, Any]:
    """Return the facts. What a question needs is imported only when it is asked."""
    match question:
        case "egl-devices":
            from catoptra_server.doctor.egl_devices import egl_devices

            return {"devices": egl_devices()}
        case "self-test":
            from catoptra_server.doctor.self_test import self_test

            return self_test(words[0])
        case "configurations":
            from catoptra_server.doctor.configurations import examine

            robots = [Path(w) for w in words[1 : 1 + int(words[0])]]
            worlds = [Path(w) for w in words[1 + int(words[0]) :]]
            return {"findings": [found.as_dict() for found in examine(robots, worlds)]}
    raise SystemExit(f"no question {question!r}")


def main() -> int:
    """Answer on stdout; return 1 after saying on stderr what kept us from it."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        facts = answer(sys.argv[1], sys.argv[2:])
    except (CatoptraError, OSError, ImportError) as error:
        print(f"{error}", file=sys.stderr)
        return 1
    print(json.dumps(facts))
    return 0


if __name__ == "__main__":
    sys.exit(main())
