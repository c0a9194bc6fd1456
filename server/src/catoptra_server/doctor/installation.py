"""Check of Python and of the installed packages against the server's own metadata."""

from __future__ import annotations

import platform
import re
import sys
from collections.abc import Iterator
from importlib import metadata

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.doctor.finding import Finding, fault, ok, warning

DISTRIBUTION = "catoptra-server"
_MIN_PYTHON = (3, 11)
_TOPIC = "packages"
# By optional package.
_LOST_WITHOUT = {
    "embreex": "no trace renderer, and robots whose sensors cast rays are refused",
}
_SYSTEMS = {
    ("Linux", "x86_64"): "trace by its native kernel, and raster; tested",
    ("Linux", "aarch64"): "raster alone, since embreex has no wheels; not tested",
    ("Darwin", "arm64"): "trace by its slow reference, no raster (EGL); not tested",
    ("Darwin", "x86_64"): "trace by its slow reference, no raster (EGL); not tested",
}
# The part of PEP 508 that the pyproject files use. `packaging` has all of it, but is a package that
# may be missing itself.
_REQUIREMENT = re.compile(r"([\w.-]+)\s*(?:\[[^]]*\])?\s*(?:(==|>=)\s*([\w.]+))?\s*(?:;(.*))?")


@dataclass(frozen=True, slots=True)
class Requirement:
    """A required package."""

    name: str
    """Name of the distribution."""
    operator: str = ""
    """`==` for this version, `>=` for at least this version, empty for any."""
    version: str = ""
    """The version; empty without an operator."""
    is_optional: bool = False
    """Whether it is required on some systems only; the server starts without it on all."""

    def is_satisfied_by(self, version: str) -> bool:
        """Whether an installed version meets the requirement."""
        required, installed = parse_release(self.version), parse_release(version)
        return installed == required if self.operator == "==" else installed >= required

    def __str__(self) -> str:
        return f"{self.name}{self.operator}{self.version}"


def parse_release(version: str) -> tuple[int, ...]:
    """Numbers of a version without trailing zeros: (5,) of 5.0, (4, 4) of 4.4.post1."""
    numbers = [int(n) for n in re.match(r"[\d.]*", version)[0].split(".") if n]  # type: ignore[index]
    # 5.0 and 5.0.0 are the same release: PEP 440.
    while numbers and not numbers[-1]:
        numbers.pop()
    return tuple(numbers)


def check_python(version: tuple[int, ...] = tuple(sys.version_info[:3])) -> Iterator[Finding]:
    """Yield whether the version of Python is supported."""
    message = (
        f"{'.'.join(map(str, version))} on {platform.machine()}, {platform.platform(terse=True)}"
    )
    if version[:2] >= _MIN_PYTHON:
        yield ok("python", message)
    else:
        remedy = "install Python 3.11 or newer, and create .venv again"
        yield fault("python", message, remedy=remedy)


def check_system(
    system: str = platform.system(), machine: str = platform.machine()
) -> Iterator[Finding]:
    """Yield what is supported on this operating system and processor."""
    supported = _SYSTEMS.get((system, machine), "unknown to the server; not tested")
    message = f"{system} on {machine}: {supported}"
    if (system, machine) == ("Linux", "x86_64"):
        yield ok("system", message)
    else:
        yield warning("system", message, remedy="Linux on x86_64 has all that is described")


def check_packages(distribution: str = DISTRIBUTION) -> Iterator[Finding]:
    """Yield the installed packages in one line, and each missing or outdated one."""
    try:
        requirements = read_requirements(distribution)
    except metadata.PackageNotFoundError:
        # Importable all the same: the source folder is on PYTHONPATH, and nothing states the
        # requirements.
        yield fault(
            _TOPIC,
            f"{distribution} is importable but not installed",
            remedy="pip install ./server",
        )
        return
    problems = [
        problem for requirement in requirements for problem in _check_requirement(requirement)
    ]
    satisfied = [r for r in requirements if not any(True for _ in _check_requirement(r))]
    if satisfied:
        listed = ", ".join(f"{r.name} {metadata.version(r.name)}" for r in satisfied)
        yield ok(_TOPIC, f"{distribution} {metadata.version(distribution)} with {listed}")
    yield from problems


def read_requirements(distribution: str) -> list[Requirement]:
    """Requirements of an installed distribution, without those of extras.

    Raises:
        importlib.metadata.PackageNotFoundError: if the distribution is not installed.
    """
    matches = (_REQUIREMENT.fullmatch(line) for line in metadata.requires(distribution) or ())
    found = (match for match in matches if match and "extra" not in (match[4] or ""))
    return [
        Requirement(match[1], match[2] or "", match[3] or "", bool(match[4])) for match in found
    ]


def _check_requirement(requirement: Requirement) -> Iterator[Finding]:
    remedy = f"pip install '{requirement}'"
    try:
        version = metadata.version(requirement.name)
    except metadata.PackageNotFoundError:
        if requirement.is_optional:
            lost = _LOST_WITHOUT.get(requirement.name, "required on some systems")
            message = f"{requirement.name} is not installed: {lost}"
            yield warning(_TOPIC, message, remedy=f"{remedy}, where it has wheels")
        else:
            yield fault(_TOPIC, f"{requirement.name} is not installed", remedy=remedy)
        return
    if not requirement.is_satisfied_by(version):
        message = f"{requirement.name} is {version}, {requirement} is required"
        yield fault(_TOPIC, message, remedy=remedy)
