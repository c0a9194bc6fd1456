"""Packages and versions, against metadata of distributions that a test writes."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_server.commands.doctor.machine import (
    Finding,
    Level,
    Requirement,
    check_packages,
    check_python,
    check_system,
    exit_status,
    parse_release,
    read_requirements,
)


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


def test_package_of_some_systems_when_missing_is_a_warning_with_what_is_lost(site: Path) -> None:
    marker = "; platform_machine == 'x86_64' or sys_platform == 'darwin'"
    install_package(site, "whole", "1.0", f"never-there>=2.1{marker}")
    (problem,) = problems("whole")
    assert problem.level is Level.WARNING
    assert problem.message.startswith("never-there is not installed: ")


@pytest.mark.parametrize(
    ("system", "machine", "level", "words"),
    [
        ("Linux", "x86_64", Level.OK, "trace by its native kernel, and raster; tested"),
        ("Linux", "aarch64", Level.WARNING, "raster alone"),
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
    assert exit_status(check_packages("never-there")) == 2


def test_this_installation_when_checked_has_no_problem() -> None:
    assert exit_status(check_packages()) == 0
    assert Requirement("numpy", ">=", "2.0") in read_requirements("catoptra-server")


@pytest.mark.parametrize(
    ("version", "numbers"), [("5.0", (5,)), ("4.4.0.post1", (4, 4)), ("13", (13,)), ("x", ())]
)
def test_release_when_read_is_its_numbers(version: str, numbers: tuple[int, ...]) -> None:
    assert parse_release(version) == numbers


@pytest.mark.parametrize(
    ("version", "status"), [((3, 10, 9), 2), ((3, 11, 0), 0), ((3, 13, 1), 0), ((4, 0, 0), 0)]
)
def test_python_when_too_old_is_a_fault(version: tuple[int, ...], status: int) -> None:
    assert exit_status(check_python(version)) == status
