"""axe-core, the accessibility checker, from npm: fetched at first use, checked, never committed."""

from __future__ import annotations

import base64
import hashlib
import shutil
import subprocess
import tarfile
from pathlib import Path
from typing import Any

from browser.tab import Tab

VERSION = "4.14.1"
# `npm view axe-core@4.14.1 dist.integrity`
INTEGRITY_SHA512 = (
    "FHfa+lmNjQZfJz1q8wKqIDwC6DExcHt/pkjNQb09a3NPjCKg2rhu5qb2S4r76ASyFNNtuFooJpZe37OgudVGtQ=="
)
_DOWNLOAD_LIMIT_S = 60.0
_RUN_LIMIT_S = 60.0
_TAGS = ("wcag2a", "wcag2aa", "wcag21a", "wcag21aa")


def load_axe(folder: Path) -> str:
    """Source of axe-core.

    Args:
        folder: Keeps the package between runs.

    Raises:
        AssertionError: npm is missing or fails, or the package is another one.
    """
    package = folder / f"axe-core-{VERSION}.tgz"
    if not package.exists():
        _download(folder)
    digest = base64.b64encode(hashlib.sha512(package.read_bytes()).digest()).decode()
    if digest != INTEGRITY_SHA512:
        package.unlink()
        raise AssertionError(f"{package} has the wrong digest {digest}; it is deleted")
    with tarfile.open(package) as archive:
        member = archive.extractfile("package/axe.min.js")
        assert member is not None, f"{package} has no axe.min.js"
        return member.read().decode("utf-8")


def _download(folder: Path) -> None:
    assert shutil.which("npm"), (
        "the accessibility test needs npm once, to fetch axe-core: apt-get install npm"
    )
    folder.mkdir(parents=True, exist_ok=True)
    command = ["npm", "pack", f"axe-core@{VERSION}", "--silent"]
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=_DOWNLOAD_LIMIT_S, check=False
    )
    assert done.returncode == 0, f"{' '.join(command)} failed: {done.stderr.strip()[-500:]}"


def find_violations(tab: Tab, source: str) -> list[str]:
    """Violations of WCAG 2.1 A and AA in a page, one line for each element."""
    tab.evaluate(f"{source}; undefined")
    options: dict[str, Any] = {
        "runOnly": {"type": "tag", "values": list(_TAGS)},
        "resultTypes": ["violations"],
    }
    found = tab.invoke(
        "async (options) => (await axe.run(document, options)).violations.flatMap("
        "(v) => v.nodes.map((n) => `${v.id}: ${n.target} ${n.failureSummary}`))",
        options,
        limit_s=_RUN_LIMIT_S,
    )
    return [str(line).replace("\n", " ")[:400] for line in found]
