"""Virtual environments outside the repository, and the wheels that are installed into them."""

from __future__ import annotations

import os
import subprocess
import venv
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

from helpers.configs import REPOSITORY
from helpers.server_process import DEADLINE_S

WHEELS = os.environ.get("CATOPTRA_WHEELS", "")
# Folder of the native kernel in wheel and source tree.
KERNEL = "catoptra_server/render/trace/kernel"

needs_wheels = pytest.mark.skipif(
    not WHEELS, reason="needs wheels and the package index: make wheels builds them and runs this"
)


@dataclass(frozen=True, slots=True)
class VirtualEnvironment:
    """A virtual environment, and an empty folder to work in."""

    folder: Path
    work: Path

    def run(self, *command: str) -> subprocess.CompletedProcess[str]:
        """Run a command of the environment to its end."""
        return subprocess.run(
            self.program_path(*command),
            cwd=self.work,
            env=clean_environment(),
            capture_output=True,
            text=True,
            check=False,
            timeout=10 * DEADLINE_S,
        )

    def program_path(self, program: str, *words: str) -> list[str]:
        """Command line of a program of the environment."""
        return [str(self.folder / "bin" / program), *words]

    def list_packages(self) -> set[str]:
        """Names of the installed distributions."""
        listed = self.run("python", "-m", "pip", "list", "--format=freeze").stdout
        return {line.partition("==")[0].lower() for line in listed.splitlines()}


def clean_environment() -> dict[str, str]:
    """Environment variables without any path into the repository."""
    return {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}


def create_environment(folder: Path, wheels: Sequence[str]) -> VirtualEnvironment:
    """Create an environment with some of the wheels and their requirements."""
    venv.create(folder / "environment", with_pip=True)
    (folder / "work").mkdir()
    environment = VirtualEnvironment(folder / "environment", folder / "work")
    installed = environment.run(
        *("python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check"),
        *("--constraint", str(REPOSITORY / "constraints.txt"), "--find-links", find_wheels()),
        *(f"{name}==0.1.0" for name in wheels),
    )
    assert installed.returncode == 0, installed.stderr
    return environment


def find_wheels() -> str:
    """Folder of the wheels that `make wheels` built."""
    return str(REPOSITORY / WHEELS)


def find_wheel(distribution: str, folder: Path | None = None) -> Path:
    """Path of the only wheel of a distribution."""
    (wheel,) = (folder or Path(find_wheels())).glob(f"{distribution}-*.whl")
    return wheel


def list_wheel_files(distribution: str, folder: Path | None = None) -> set[str]:
    """Paths of the files in a wheel."""
    return set(zipfile.ZipFile(find_wheel(distribution, folder)).namelist())
