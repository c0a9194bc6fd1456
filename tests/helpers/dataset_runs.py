"""Runs of `catoptra-server dataset` as a program, and what they leave."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

COMMAND = (sys.executable, "-m", "catoptra_server", "dataset")
# A run of six samples of 64 px takes 3 s on an idle machine.
TIMEOUT_S = 600.0


def run_dataset(recipe: Path, folder: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Run the command to its end."""
    return subprocess.run(
        [*COMMAND, str(recipe), "--out", str(folder), *options],
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )


def read_hashes(folder: Path) -> dict[str, str]:
    """Hash of each shard by its path, as the manifest has them."""
    manifest = json.loads((folder / "dataset.json").read_text(encoding="utf-8"))
    return {shard["path"]: shard["sha256"] for shard in manifest["shards"]}
