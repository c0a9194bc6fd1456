"""The wheels in virtual environments outside the repository: complete, and without extras.

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
    return str(REPOSITORY / WHEELS)


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> VirtualEnvironment:
    return create_environment(tmp_path_factory.mktemp("server"), ["catoptra-server"])


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> VirtualEnvironment:
    return create_environment(tmp_path_factory.mktemp("client"), ["catoptra-client"])


@pytest.fixture(scope="module")
def studies(tmp_path_factory: pytest.TempPathFactory) -> VirtualEnvironment:
    return create_environment(tmp_path_factory.mktemp("studies"), ["catoptra-studies"])


def list_wheel_files(distribution: str) -> set[str]:
    """Paths of the files in a wheel."""
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


OF_THE_SERVER = {"moderngl", "glcontext", "embreex", "catoptra-server", "trimesh"}
OF_THE_STUDIES = {"matplotlib", "rich", "catoptra-studies"}


def test_client_when_installed_brings_no_server_and_no_plots(client: VirtualEnvironment) -> None:
    packages = client.list_packages()
    assert "catoptra-client" in packages
    assert packages & (OF_THE_SERVER | OF_THE_STUDIES) == set()


def test_server_when_installed_brings_no_plots(server: VirtualEnvironment) -> None:
    packages = server.list_packages()
    assert packages >= OF_THE_SERVER
    assert packages & OF_THE_STUDIES == set()


def test_studies_when_installed_without_server_run_the_demo_alone(
    studies: VirtualEnvironment,
) -> None:
    packages = studies.list_packages()
    assert packages >= OF_THE_STUDIES
    assert packages & OF_THE_SERVER == set()
    helped = studies.run("catoptra-studies", "demo", "--help")
    assert helped.returncode == 0, helped.stderr
    figures = studies.run("catoptra-studies", "figures")
    assert figures.returncode == 2
    assert "pip install 'catoptra-studies[server]'" in figures.stderr


def test_doctor_when_installed_finds_all_configurations_valid(server: VirtualEnvironment) -> None:
    ports = ("--control-port", "0", "--image-port", "0", "--stream-port", "0")
    report = server.run("catoptra-server", "doctor", *ports)
    assert report.returncode in (0, 1), report.stdout + report.stderr  # 1: no OpenGL here
    assert "ok       robot p2at_omni: USARBot.OmniP2AT" in report.stdout
    assert "ok       world rescue" in report.stdout
    assert str(REPOSITORY) not in report.stdout


def test_client_when_installed_detects_landmarks_in_frames_of_the_server(
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
            match = LISTENING_PATTERN.fullmatch(process.stdout.readline())
            assert match
            address = ("--control-port", match[1], "--image-port", match[2])
            trained = client.run("catoptra-client", "train", "--frames", "10", *address)
            assert trained.returncode == 0, trained.stderr
            printed = client.run("catoptra-client", "bearings", "--frames", "2", *address)
            assert printed.returncode == 0, printed.stderr
            assert "over" in printed.stdout
        finally:
            process.terminate()
            process.wait(DEADLINE_S)


def test_raster_when_installed_finds_its_shaders(server: VirtualEnvironment) -> None:
    code = (
        "from catoptra_server.render.raster import shader_programs\n"
        "import importlib.resources as r\n"
        "assert r.files('catoptra_server').joinpath('glsl/face.frag').is_file()\n"
        "assert 'site-packages' in shader_programs.__file__"
    )
    imported = server.run("python", "-c", code)
    assert imported.returncode == 0, imported.stderr
