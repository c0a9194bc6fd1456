"""The wheels in virtual environments outside the repository: complete, and without extras.

Needs the package index and a minute or two: `make wheels` builds the wheels and runs this.
"""

from __future__ import annotations

import subprocess
import zipfile

import pytest

from helpers.configs import REPOSITORY
from helpers.server_process import DEADLINE_S, LISTENING_PATTERN
from helpers.virtual_environments import (
    KERNEL,
    VirtualEnvironment,
    clean_environment,
    create_environment,
    find_wheel,
    list_wheel_files,
    needs_wheels,
)

pytestmark = needs_wheels


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> VirtualEnvironment:
    return create_environment(tmp_path_factory.mktemp("server"), ["catoptra-server"])


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> VirtualEnvironment:
    return create_environment(tmp_path_factory.mktemp("client"), ["catoptra-client"])


@pytest.fixture(scope="module")
def studies(tmp_path_factory: pytest.TempPathFactory) -> VirtualEnvironment:
    return create_environment(tmp_path_factory.mktemp("studies"), ["catoptra-studies"])


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


OF_THE_SERVER = {"moderngl", "glcontext", "catoptra-server", "trimesh"}
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
            trained = client.run("catoptra-client", "train", "--training-frames", "10", *address)
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


def test_wheel_when_built_with_the_kernel_is_for_its_platform_and_every_python() -> None:
    wheel = find_wheel("catoptra_server")
    assert wheel.name == "catoptra_server-0.1.0-py3-none-manylinux2014_x86_64.whl"
    described = zipfile.ZipFile(wheel).read("catoptra_server-0.1.0.dist-info/WHEEL").decode()
    assert "Root-Is-Purelib: false" in described
    files = list_wheel_files("catoptra_server")
    libraries = {f"{KERNEL}/libcatoptra_trace{suffix}.so" for suffix in ("", "_avx2", "_avx512")}
    assert libraries <= set(files)
    assert [name for name in files if name.endswith((".c", ".h", "not_built.txt"))] == []


def test_kernel_when_installed_loads(server: VirtualEnvironment) -> None:
    code = (
        "import ctypes\n"
        "from catoptra_server.render.trace.kernel.library import kernel_library_path\n"
        "for instruction_set in ('sse4.2', 'avx2'):\n"
        "    path = str(kernel_library_path(instruction_set))\n"
        "    assert 'site-packages' in path\n"
        "    assert ctypes.CDLL(path).catoptra_abi(0) > 0"
    )
    loaded = server.run("python", "-c", code)
    assert loaded.returncode == 0, loaded.stderr
