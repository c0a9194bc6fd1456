"""`python -m catoptra_studies`: the same command as `catoptra-studies`."""

from __future__ import annotations

import sys

from catoptra_studies.cli import main

if __name__ == "__main__":
    sys.exit(main())
