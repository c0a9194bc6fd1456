"""The files of the page, and its panels."""

from __future__ import annotations

import re
from pathlib import Path

from helpers.configs import REPOSITORY

STATIC = REPOSITORY / "server/src/catoptra_server/serve/web/static"
_PANEL = re.compile(r"""\{\s*id:\s*"(\w+)",.*?from\("\./([\w/]+\.js)"\)""")


def list_files() -> list[Path]:
    """All files of the page."""
    return sorted(path for path in STATIC.rglob("*") if path.is_file())


def list_scripts() -> list[str]:
    """Own scripts, relative to the folder of the page."""
    names = (path.relative_to(STATIC).as_posix() for path in list_files())
    return [name for name in names if name.endswith(".js") and not name.startswith("vendor/")]


def panel_scripts() -> dict[str, str]:
    """Script of each panel by its id, in the order of the page."""
    return dict(_PANEL.findall((STATIC / "panels.js").read_text(encoding="utf-8")))
