"""Findings and their exit status; packages, ports, processors."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from catoptra_server.commands.doctor import machine as machine_module
from catoptra_server.commands.doctor.machine import (
    Finding,
    Level,
    check_packages,
    check_ports,
    check_processors,
    check_python,
    check_running_server,
    check_system,
    check_view_port,
    exit_status,
    fault,
    ok,
    warning,
)
from catoptra_server.commands.server import VIEW_PORT
from client.scripted_server import serve_script

FACT = ok("python", "3.11")
WARNING = warning("opengl", "none", remedy="install it")
FAULT = fault("ports", "taken", remedy="take another")


@pytest.mark.parametrize(
    ("found", "status"),
    [((), 0), ((FACT,), 0), ((FACT, WARNING), 0), ((WARNING, FAULT, FACT), 1)],
    ids=["nothing", "facts", "warning", "fault"],
)
def test_status_is_that_of_a_fault(found: tuple[Finding, ...], status: int) -> None:
    assert exit_status(found) == status


def test_problem_when_printed_is_one_line_with_its_remedy() -> None:
    assert str(FAULT) == "fault    ports: taken. Remedy: take another"
    assert str(FACT) == "ok       python: 3.11"


def test_finding_when_sent_as_json_comes_back() -> None:
    assert Finding.from_json(WARNING.to_json()) == WARNING


def install_package(folder: Path, name: str, version: str, *requires: str) -> None:
    """Write the metadata of a distribution."""
    info = folder / f"{name}-{version}.dist-info"
    info.mkdir()
    lines = [f"Name: {name}", f"Version: {version}", *(f"Requires-Dist: {r}" for r in requires)]
    (info / "METADATA").write_text("\n".join(["Metadata-Version: 2.1", *lines, ""]))


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Folder of distributions that Python searches first."""
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path


def problems(distribution: str) -> list[Finding]:
    """Problems of a distribution's requirements."""
    return [f for f in check_packages(distribution) if f.level is not Level.OK]


def test_package_when_too_old_is_named_with_the_required_version(site: Path) -> None:
    install_package(site, "whole", "1.0", "part>=2.1")
    install_package(site, "part", "2.0.9")
    (problem,) = problems("whole")
    assert problem.message == "part is 2.0.9, part>=2.1 is required"
    assert problem.remedy == "pip install 'part>=2.1'"


@pytest.mark.parametrize(
    ("system", "machine", "level", "words"),
    [
        ("Linux", "x86_64", Level.OK, "trace by its native kernel, and raster; tested"),
        ("Linux", "aarch64", Level.WARNING, "native kernel, and raster; tested under emulation"),
        ("Darwin", "arm64", Level.WARNING, "no raster"),
        ("Plan9", "mips", Level.WARNING, "unknown to the server"),
    ],
)
def test_system_is_named_with_what_is_supported_on_it(
    system: str, machine: str, level: Level, words: str
) -> None:
    (found,) = check_system(system, machine)
    assert found.level is level
    assert f"{system} on {machine}: " in found.message
    assert words in found.message


def test_package_when_missing_is_named(site: Path) -> None:
    install_package(site, "whole", "1.0", "never-there>=2.1")
    (problem,) = problems("whole")
    assert problem.message == "never-there is not installed"


def test_packages_when_all_satisfy_are_listed(site: Path) -> None:
    install_package(site, "whole", "1.0", "part>=2.1", "exact==3.0", 'never; extra == "more"')
    install_package(site, "part", "10.0")
    install_package(site, "exact", "3.0")
    assert [f.message for f in check_packages("whole")] == ["whole 1.0 with part 10.0, exact 3.0"]


def test_distribution_when_not_installed_is_a_fault() -> None:
    assert exit_status(check_packages("never-there")) == 1


def test_this_installation_when_checked_has_no_problem() -> None:
    (found,) = check_packages()
    assert found.level is Level.OK
    assert " numpy 2." in found.message


@pytest.mark.parametrize(
    ("required", "version", "is_met"),
    [
        ("==5.0.0", "5.0", True),
        ("==4.4", "4.4.0.post1", True),
        ("==4.4", "4.4.1", False),
        (">=9", "13", True),
        (">=1", "x", False),
    ],
)
def test_release_when_required_is_compared_by_its_numbers(
    site: Path, required: str, version: str, is_met: bool
) -> None:
    install_package(site, "whole", "1.0", f"part{required}")
    install_package(site, "part", version)
    assert (problems("whole") == []) is is_met


@pytest.mark.parametrize(
    ("version", "status"), [((3, 10, 9), 1), ((3, 11, 0), 0), ((3, 13, 1), 0), ((4, 0, 0), 0)]
)
def test_python_when_too_old_is_a_fault(version: tuple[int, ...], status: int) -> None:
    assert exit_status(check_python(version)) == status


HOST = "127.0.0.1"


@pytest.fixture
def occupied_port() -> Iterator[int]:
    """A port on which a silent program listens."""
    with socket.create_server((HOST, 0)) as listener:
        yield listener.getsockname()[1]


def test_ports_when_any_free_ones_will_do_have_no_problem() -> None:
    (found,) = check_ports(HOST, {"control": 0, "image": 0})
    assert found.level is Level.OK


def test_port_when_taken_is_a_fault_that_names_the_option(occupied_port: int) -> None:
    (found,) = check_ports(HOST, {"control": 0, "image": occupied_port})
    assert found.level is Level.FAULT
    assert f"image port {occupied_port}" in found.message
    assert "--image-port" in found.remedy


def test_address_when_not_of_this_machine_is_a_fault_that_names_the_option() -> None:
    (found,) = check_ports("192.0.2.1", {"control": 0})  # RFC 5737: no machine's
    assert "--host" in found.remedy


@pytest.mark.parametrize(
    ("greeting", "level"), [(b"NFO {Gametype x}\r\n", Level.OK), (b"SSH-2.0\r\n", Level.FAULT)]
)
def test_server_is_found_by_its_greeting(greeting: bytes, level: Level) -> None:
    with serve_script(lambda connection: connection.sendall(greeting)) as port:
        (found,) = check_running_server(HOST, {"control": port})
    assert found.level is level


def test_server_when_no_program_listens_is_a_fault() -> None:
    with socket.socket() as unused:
        unused.bind((HOST, 0))
        port = unused.getsockname()[1]
        assert exit_status(check_running_server(HOST, {"control": port, "image": port})) == 1


def test_view_port_when_taken_is_a_fault_only_if_it_was_requested(
    occupied_port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine_module, "_DEFAULT_VIEW_PORT", occupied_port)
    (requested,) = check_view_port(HOST, occupied_port)
    (default,) = check_view_port(HOST, None)
    (free,) = check_view_port(HOST, 0)
    assert (requested.level, default.level, free.level) == (Level.FAULT, Level.WARNING, Level.OK)
    assert "--view 0" in requested.remedy


def test_default_view_port_is_that_of_the_server() -> None:
    assert machine_module._DEFAULT_VIEW_PORT == VIEW_PORT


@pytest.mark.parametrize(
    ("text", "remedy"),
    [
        ("200000 100000", "--threads 2"),
        ("150000 100000", "--threads 1"),
        ("50000 100000", "--threads 1"),
        ("800000 100000", ""),
        ("max 100000", ""),
        ("", ""),
    ],
)
def test_threads_when_more_than_a_container_s_limit_are_a_warning(
    tmp_path: Path, text: str, remedy: str
) -> None:
    (tmp_path / "cpu.max").write_text(text)
    (found,) = check_processors(8, tmp_path / "cpu.max")
    assert found.level is (Level.WARNING if remedy else Level.OK)
    assert found.remedy == remedy


def test_threads_when_there_is_no_limit_are_no_problem(tmp_path: Path) -> None:
    (found,) = check_processors(8, tmp_path / "none")
    assert (found.level, found.message) == (Level.OK, "8 processors")
