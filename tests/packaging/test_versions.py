"""Versions of the distributions."""

from __future__ import annotations

import tomllib
from pathlib import Path

import catoptra_server

REPOSITORY = Path(__file__).parents[2]


def test_version_of_the_server_is_that_of_its_distribution() -> None:
    project = tomllib.loads((REPOSITORY / "server/pyproject.toml").read_text(encoding="utf-8"))
    assert catoptra_server.__version__ == project["project"]["version"]
