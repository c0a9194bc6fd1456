"""Python and the packages: what is installed, against what the server's own metadata requires."""

from __future__ import annotations

import platform
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata

from catoptra_server.doctor.finding import Finding, fault, ok

DISTRIBUTION = "catoptra-server"
_MIN_PYTHON = (3, 11)
_TOPIC = "packages"
# As much of PEP 508 as the pyproject files use.
_REQUIREMENT = re.compile(r"([\w.-]+)\s*(?:\[[^]]*\])?\s*(?:(==|>=)\s*([\w.]+))?\s*(?:;(.*))?")


@dataclass(frozen=True, slots=True)
class Requirement:
    """A package, and the version that it must have (==), or have at least (>=); "" = any."""

    name: str
    operator: str = ""
    version: str = ""

    def is_satisfied_by(self, version: str) -> bool:
        """Return whether a version will do."""
        wanted, found = parse_release(self.version), parse_release(version)
        return found == wanted if self.operator == "==" else found >= wanted

    def __str__(self) -> str:
        return f"{self.name}{self.operator}{self.version}"


def parse_release(version: str) -> tuple[int, ...]:
    """Return a version's numbers without zeros at the end: (5,) of 5.0, (4, 4) of 4.4.post1."""
    numbers = [int(n) for n in re.match(r"[\d.]*", version)[0].split(".") if n]  # type: ignore[index]
    while numbers and not numbers[-1]:
        numbers.pop()
    return tuple(numbers)


def check_python(version: tuple[int, ...] = tuple(sys.version_info[:3])) -> Iterator[Finding]:
    """Yield whether this Python will do."""
    what = f"{'.'.join(map(str, version))} on {platform.machine()}, {platform.platform(terse=True)}"
    if version[:2] >= _MIN_PYTHON:
        yield ok("python", what)
    else:
        yield fault("python", what, remedy="install Python 3.11 or newer, and make .venv anew")


def check_packages(distribution: str = DISTRIBUTION) -> Iterator[Finding]:
    """Yield what is missing or too old, or one line that lists what is there."""
    try:
        wanted = read_requirements(distribution)
    except metadata.PackageNotFoundError:
        yield fault(
            _TOPIC, f"{distribution} is not installed, only found", remedy="pip install ./server"
        )
        return
    problems = [problem for requirement in wanted for problem in _check_requirement(requirement)]
    there = [r for r in wanted if not any(True for _ in _check_requirement(r))]
    if there:
        listed = ", ".join(f"{r.name} {metadata.version(r.name)}" for r in there)
        yield ok(_TOPIC, f"{distribution} {metadata.version(distribution)} with {listed}")
    yield from problems


def read_requirements(distribution: str) -> list[Requirement]:
    """Return what a distribution requires, extras left out. Raises PackageNotFoundError."""
    read = (_REQUIREMENT.fullmatch(line) for line in metadata.requires(distribution) or ())
    found = (match for match in read if match and "extra" not in (match[4] or ""))
    return [Requirement(match[1], match[2] or "", match[3] or "") for match in found]


def _check_requirement(requirement: Requirement) -> Iterator[Finding]:
    remedy = f"pip install '{requirement}'"
    try:
        version = metadata.version(requirement.name)
    except metadata.PackageNotFoundError:
        yield fault(_TOPIC, f"{requirement.name} is not installed", remedy=remedy)
        return
    if not requirement.is_satisfied_by(version):
        what = f"{requirement.name} is {version}, {requirement} is needed"
        yield fault(_TOPIC, what, remedy=remedy)
