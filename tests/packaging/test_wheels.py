"""The wheels in environments of their own, outside the repository: everything they need is in them.

Needs the package index and a minute or two: `make wheels` builds the wheels and runs this.
"""

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
from helpers.server_process import DEADLINE_S, LISTENING_PATTERN

WHEELS = os.environ.get("CATOPTRA_WHEELS", "")

pytestmark = pytest.mark.skipif(
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
        """Return the command line of a program of the environment."""
        return [str(self.folder / "bin" / program), *words]

    def list_packages(self) -> set[str]:
        """Return the names of what is installed."""
        listed = self.run("python", "-m", "pip", "list", "--format=freeze").stdout
        return {line.partition("==")[0].lower() for line in listed.splitlines()}


def clean_environment() -> dict[str, str]:
    """Return an environment that knows nothing of the repository."""
    return {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}


def create_environment(folder: Path, wheels: Sequence[str]) -> VirtualEnvironment:
    """Make an environment that holds some of the wheels and what they require."""
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
    return str(REPOSITORY / WHEELS)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> VirtualEnvironment:
    return create_environment(tmp_path_factory.mktemp("server"), ["catoptra-server"])


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> VirtualEnvironment:
    return create_environment(tmp_path_factory.mktemp("client"), ["catoptra-client"])


def list_wheel_files(distribution: str) -> set[str]:
    """Return the files in a wheel."""
    (wheel,) = Path(find_wheels()).glob(f"{distribution}-*.whl")
    return set(zipfile.ZipFile(wheel).namelist())


@pytest.mark.parametrize(
    ("distribution", "source", "inside"),
    [
        ("catoptra_server", "configs", "catoptra_server/configs"),
        ("catoptra_server", "server/src/catoptra_server/glsl", "catoptra_server/glsl"),
        ("catoptra_client", "configs/landmarks", "catoptra_client/configs/landmarks"),
    ],
)
def test_wheel_when_built_holds_every_file_of_a_folder(
    distribution: str, source: str, inside: str
) -> None:
    folder = REPOSITORY / source
    files = [path for path in folder.rglob("*") if path.is_file()]
    assert files
    expected = {f"{inside}/{path.relative_to(folder).as_posix()}" for path in files}
    assert expected <= list_wheel_files(distribution)


def test_client_when_installed_brings_no_opengl_and_no_server(client: VirtualEnvironment) -> None:
    packages = client.list_packages()
    assert "catoptra-client" in packages
    assert packages & {"moderngl", "glcontext", "embreex", "catoptra-server", "trimesh"} == set()


def test_doctor_when_installed_finds_all_configurations_well(server: VirtualEnvironment) -> None:
    ports = ("--control-port", "0", "--image-port", "0", "--stream-port", "0")
    examined = server.run("catoptra-server", "doctor", *ports)
    assert examined.returncode in (0, 1), examined.stdout + examined.stderr  # 1: no OpenGL here
    assert "ok       robot p2at_omni: USARBot.OmniP2AT" in examined.stdout
    assert "ok       world rescue" in examined.stdout
    assert str(REPOSITORY) not in examined.stdout


def test_client_when_installed_sees_what_the_server_serves(
    server: VirtualEnvironment, client: VirtualEnvironment
) -> None:
    serve = server.program_path(
        *("catoptra-server", "--robot", "p2at_omni", "--world", "four_legged_2006"),
        *("--control-port", "0", "--image-port", "0"),
    )
    with subprocess.Popen(
        serve, cwd=server.work, env=clean_environment(), stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            assert process.stdout is not None, "stdout is a pipe"
            found = LISTENING_PATTERN.fullmatch(process.stdout.readline())
            assert found
            there = ("--control-port", found[1], "--image-port", found[2])
            trained = client.run("catoptra-client", "train", "--frames", "10", *there)
            assert trained.returncode == 0, trained.stderr
            watched = client.run("catoptra-client", "bearings", "--frames", "2", *there)
            assert watched.returncode == 0, watched.stderr
            assert "over" in watched.stdout
        finally:
            process.terminate()
            process.wait(DEADLINE_S)


def test_raster_when_installed_finds_its_shaders(server: VirtualEnvironment) -> None:
    code = (
        "from catoptra_server.render.raster import programs\n"
        "import importlib.resources as r\n"
        "assert r.files('catoptra_server').joinpath('glsl/face.frag').is_file()\n"
        "assert 'site-packages' in programs.__file__"
    )
    looked = server.run("python", "-c", code)
    assert looked.returncode == 0, looked.stderr
