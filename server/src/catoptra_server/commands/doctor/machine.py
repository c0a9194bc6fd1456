"""Checks of the machine and the installation that need no library: each yields findings.

A finding is a fact, or a problem with a remedy; a fault sets the exit status. Python and the
installed packages are compared with the server's own metadata, ports are tried by the server's own
call, and the number of threads is compared with the limit of a control group.
"""

from __future__ import annotations

import errno
import platform
import re
import socket
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from enum import Enum
from importlib import metadata
from pathlib import Path

from catoptra_protocol.command_line import EXIT_FAILURE
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.runtime.memory import count_processors

_DISTRIBUTION = "catoptra-server"
_MIN_PYTHON = (3, 11)
_TOPIC = "packages"
_SYSTEMS = {
    ("Linux", "x86_64"): "trace by its native kernel, and raster; tested",
    ("Linux", "aarch64"): "trace by its native kernel, and raster; tested under emulation",
    ("Darwin", "arm64"): "trace by its native kernel, no raster (EGL); not run",
    ("Darwin", "x86_64"): "trace by its slow reference, no raster (EGL); not tested",
}
# The part of PEP 508 that the pyproject files use. `packaging` has the whole, but is a package that
# may be missing itself.
_REQUIREMENT = re.compile(r"([\w.-]+)\s*(?:\[[^]]*\])?\s*(?:(==|>=)\s*([\w.]+))?\s*(?:;(.*))?")
# First bytes of USARSim's greeting line, which the control port sends without a request.
_GREETING = b"NFO"
_TIMEOUT_S = 2.0
# As commands/server.py:VIEW_PORT, whose module would load the whole server.
_DEFAULT_VIEW_PORT = 5080
# cgroup v2, by which container engines limit processor time. The affinity mask, which gives trace
# the number of threads, does not show this limit.
_CPU_LIMIT_FILE = Path("/sys/fs/cgroup/cpu.max")


class Level(Enum):
    """Severity: with a warning the server can start, with a fault not."""

    OK = "ok"
    WARNING = "warning"
    FAULT = "fault"


@dataclass(frozen=True, slots=True)
class Finding:
    """Result of one check, printed as one line."""

    level: Level
    """Severity."""
    topic: str
    """Subject, such as `packages` or `raster on device 0`."""
    message: str
    """The observed state, or the problem."""
    remedy: str = ""
    """A command or an action that solves the problem; empty for a fact."""

    @classmethod
    def from_json(cls, values: dict[str, str]) -> Finding:
        """Finding of the values that `to_json` gives."""
        return cls(Level(values["level"]), values["topic"], values["message"], values["remedy"])

    def to_json(self) -> dict[str, str]:
        """Values for JSON."""
        return asdict(self) | {"level": self.level.value}

    def __str__(self) -> str:
        line = f"{self.level.value:<8} {self.topic}: {self.message}"
        return f"{line}. Remedy: {self.remedy}" if self.remedy else line


def ok(topic: str, message: str) -> Finding:
    """A fact."""
    return Finding(Level.OK, topic, message)


def warning(topic: str, message: str, *, remedy: str) -> Finding:
    """A problem with which the server can start."""
    return Finding(Level.WARNING, topic, message, remedy)


def fault(topic: str, message: str, *, remedy: str) -> Finding:
    """A problem that keeps the server from starting."""
    return Finding(Level.FAULT, topic, message, remedy)


def exit_status(findings: Iterable[Finding]) -> int:
    """Exit status of the doctor: 1 with a fault, else 0."""
    return EXIT_FAILURE if any(finding.level is Level.FAULT for finding in findings) else 0


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


def check_packages(distribution: str = _DISTRIBUTION) -> Iterator[Finding]:
    """Yield the installed packages in one line, and each missing or outdated one."""
    try:
        requirements = _read_requirements(distribution)
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


@dataclass(frozen=True, slots=True)
class _PackageRequirement:
    """A required package."""

    name: str
    """Name of the distribution."""
    operator: str = ""
    """`==` for this version, `>=` for at least this version, empty for any."""
    version: str = ""
    """The version; empty without an operator."""

    def is_satisfied_by(self, version: str) -> bool:
        """Whether an installed version meets the requirement."""
        required, installed = _parse_release(self.version), _parse_release(version)
        return installed == required if self.operator == "==" else installed >= required

    def __str__(self) -> str:
        return f"{self.name}{self.operator}{self.version}"


def _read_requirements(distribution: str) -> list[_PackageRequirement]:
    """Requirements of an installed distribution, without extras.

    Raises:
        importlib.metadata.PackageNotFoundError: if the distribution is not installed.
    """
    matches = (_REQUIREMENT.fullmatch(line) for line in metadata.requires(distribution) or ())
    found = (match for match in matches if match and "extra" not in (match[4] or ""))
    return [_PackageRequirement(match[1], match[2] or "", match[3] or "") for match in found]


def _check_requirement(requirement: _PackageRequirement) -> Iterator[Finding]:
    remedy = f"pip install '{requirement}'"
    try:
        version = metadata.version(requirement.name)
    except metadata.PackageNotFoundError:
        yield fault(_TOPIC, f"{requirement.name} is not installed", remedy=remedy)
        return
    if not requirement.is_satisfied_by(version):
        message = f"{requirement.name} is {version}, {requirement} is required"
        yield fault(_TOPIC, message, remedy=remedy)


def _parse_release(version: str) -> tuple[int, ...]:
    """Numbers of a version without trailing zeros: (5,) of 5.0, (4, 4) of 4.4.post1."""
    numbers = [int(n) for n in re.match(r"[\d.]*", version)[0].split(".") if n]  # type: ignore[index]
    # 5.0 and 5.0.0 are the same release: PEP 440.
    while numbers and not numbers[-1]:
        numbers.pop()
    return tuple(numbers)


def check_ports(host: str, ports: Mapping[str, int]) -> Iterator[Finding]:
    """Yield whether the server can listen on each port.

    Args:
        host: address on which the server will listen.
        ports: port by the name of the option, such as control; 0 = any free one.
    """
    problems = [
        problem for name, port in ports.items() for problem in _check_port(host, name, port)
    ]
    if not problems:
        listed = ", ".join(f"{name} {port or 'any'}" for name, port in ports.items())
        yield ok("ports", f"free on {host}: {listed}")
    yield from problems


def check_view_port(host: str, port: int | None) -> Iterator[Finding]:
    """Yield whether the server can listen on the port of the live page.

    Args:
        host: address on which the server will listen.
        port: requested port, 0 = any free one; None for the default, which may be in use.
    """
    wanted = _DEFAULT_VIEW_PORT if port is None else port
    try:
        socket.create_server((host, wanted)).close()
    except OSError as error:
        message = f"view port {wanted} on {host}: {_error_text(error)}"
        if port is None:
            remedy = "the server takes a free port and prints it; --view 0 or --no-view"
            yield warning("live page", message, remedy=remedy)
        else:
            yield fault("live page", message, remedy="take a free port: --view 0, or --no-view")
    else:
        yield ok("live page", f"port {wanted or 'any'} is free on {host}")


def _check_port(host: str, name: str, port: int) -> Iterator[Finding]:
    # A real attempt, with SO_REUSEADDR as the server's own sockets have: a connection attempt would
    # take a firewalled port for a free one.
    try:
        socket.create_server((host, port)).close()
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            remedy = f"end the program that listens there, or take a free port: --{name}-port 0"
        elif isinstance(error, PermissionError):
            remedy = f"ports below 1024 need privileges: choose another --{name}-port"
        else:
            remedy = "--host is an address of this machine: 127.0.0.1, or 0.0.0.0 for all"
        yield fault("ports", f"{name} port {port} on {host}: {_error_text(error)}", remedy=remedy)


def check_running_server(host: str, ports: Mapping[str, int]) -> Iterator[Finding]:
    """Yield whether a server accepts connections on each port and greets on the control port."""
    for name, port in ports.items():
        try:
            with socket.create_connection((host, port), timeout=_TIMEOUT_S) as connection:
                if name == "control" and connection.recv(len(_GREETING)) != _GREETING:
                    raise OSError("no USARSim greeting was received")
        except OSError as error:
            remedy = "the server's log has the reason; start the server again"
            yield fault(name, f"no server at {host}:{port}: {_error_text(error)}", remedy=remedy)
        else:
            # The image port is silent until a request: an accepted connection has to do.
            yield ok(name, f"a server answers at {host}:{port}")


def _error_text(error: Exception) -> str:
    # strerror without the number in brackets; a timeout has none.
    text: str = getattr(error, "strerror", None) or str(error)
    return text


def check_processors(
    count: int | None = None, limit_file: Path = _CPU_LIMIT_FILE
) -> Iterator[Finding]:
    """Yield the number of processors, or a warning where more threads than processors would run.

    Args:
        count: processors of the affinity mask; None = of this process.
        limit_file: cpu.max of the control group.
    """
    count = count_processors() if count is None else count
    limit = _read_cpu_limit(limit_file)
    if limit is not None and limit < count:
        threads = max(1, int(limit))
        yield warning(
            "threads",
            f"{count} processors, of which {limit:g} may be used: trace starts {count} threads",
            remedy=f"--threads {threads}",
        )
    else:
        yield ok("threads", f"{count} processors")


def _read_cpu_limit(file: Path) -> float | None:
    """Processor seconds per second that a control group grants; None without a limit."""
    try:
        quota, period = file.read_text(encoding="ascii").split()
    # Absent outside containers and with cgroup v1: no limit is known then.
    except (OSError, ValueError):
        return None
    return None if quota == "max" else int(quota) / int(period)
