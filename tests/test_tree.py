"""Rules of the tree that import-linter (`make lint`) cannot check.

Tests for every folder with behaviour, sockets in few modules, no clocks in the protocol, no sleeps
in tests, no paths of one machine.
"""

from __future__ import annotations

import ast
import re
import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path, PurePosixPath

import pytest

from helpers.configs import REPOSITORY

PACKAGES = ("protocol", "server", "client", "studies")

# Modules that open sockets; a folder stands for all modules in it. Third-party packages have
# contracts in pyproject.toml.
SOCKET_MODULES = (
    "client/tcp.py",
    "client/control_connection.py",
    "client/robot_client.py",
    "client/frame_sources",
    "server/serve",
    "server/commands/doctor/machine.py",
)
# The protocol is sans-I/O: bytes in, events out.
NOT_IN_THE_PROTOCOL = {"socket", "asyncio", "time", "select", "selectors", "threading", "random"}


def sources(package: str) -> Iterator[tuple[str, Path]]:
    """Yield the name of each module, package and path in it, and its path on disk."""
    root = REPOSITORY / package / "src" / f"catoptra_{package}"
    for path in sorted(root.rglob("*.py")):
        yield f"{package}/{path.relative_to(root).as_posix()}", path


ALL_SOURCES = [source for package in PACKAGES for source in sources(package)]


def find_tests(folder: str) -> list[Path]:
    """Test files of a folder of the product: those in its mirror, or the one with its name."""
    mirror = REPOSITORY / "tests" / folder
    return [*mirror.glob("test_*.py"), *mirror.parent.glob(f"test_{mirror.name}.py")]


@cache
def nodes_of(path: Path) -> list[ast.AST]:
    """All nodes of a module's syntax tree."""
    return list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


@cache
def imported_packages(path: Path) -> frozenset[str]:
    """Top-level names of all imports of a module, those inside functions too."""
    names: set[str] = set()
    for node in nodes_of(path):
        if isinstance(node, ast.Import):
            names.update(alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.partition(".")[0])
    return frozenset(names)


def has_behaviour(path: Path) -> bool:
    """Whether a module computes anything: data and Protocols have no function with a body."""
    nodes = nodes_of(path)
    functions = (n for n in nodes if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef))
    return any(not _is_text(statement) for function in functions for statement in function.body)


def _is_text(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)


# Not when this file is collected, which each worker does: the syntax trees take 3 s.
@pytest.fixture(scope="module")
def folders() -> set[str]:
    """Folders with a module that computes something."""
    return {str(PurePosixPath(name).parent) for name, path in ALL_SOURCES if has_behaviour(path)}


# Not each module: which file a function stands in is no idea, and each idea has a test file.
def test_folders_with_behaviour_have_tests(folders: set[str]) -> None:
    assert [folder for folder in sorted(folders) if not find_tests(folder)] == []


def test_folders_and_their_tests_are_found(folders: set[str]) -> None:
    assert {"server/frames", "protocol/optics/lenses", "client", "studies/experiment"} <= folders
    assert find_tests("server/frames")
    assert not find_tests("server/no_such_folder")


def test_sockets_are_opened_in_few_modules() -> None:
    elsewhere = [
        name
        for name, path in ALL_SOURCES
        if "socket" in imported_packages(path)
        and not any(name == known or name.startswith(f"{known}/") for known in SOCKET_MODULES)
    ]
    assert elsewhere == []


def test_protocol_imports_neither_sockets_nor_clocks() -> None:
    protocol = {
        name: path
        for name, path in ALL_SOURCES
        if name.startswith(("protocol/usarsim/", "protocol/stream/"))
    }
    assert protocol
    assert [
        name for name, path in protocol.items() if imported_packages(path) & NOT_IN_THE_PROTOCOL
    ] == []


def test_data_classes_that_a_server_loads_are_slotted_ones() -> None:
    own = "protocol/slotted_dataclass.py"
    standard = re.compile(r"^from dataclasses import .*\bdataclass\b|@dataclasses\.", re.MULTILINE)
    loaded = [(n, p) for n, p in ALL_SOURCES if n.startswith(("protocol/", "server/")) and n != own]
    assert [name for name, path in loaded if standard.search(path.read_text("utf-8"))] == []


def test_tests_when_they_wait_do_not_sleep() -> None:
    asleep = re.compile(r"\btime\.sleep\(|asyncio\.sleep\((?!0\))")
    files = [p for p in (REPOSITORY / "tests").rglob("test_*.py") if p != Path(__file__)]
    assert files
    assert [path.name for path in files if asleep.search(path.read_text(encoding="utf-8"))] == []


def test_files_when_committed_name_no_path_of_one_machine() -> None:
    private = re.compile(r"/(?:work|home|root|Users)/[A-Za-z0-9_.]")
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=REPOSITORY, capture_output=True, text=True, check=False
    )
    if listed.returncode:
        pytest.skip("needs a git checkout to know which files are the project's")
    names = [name for name in listed.stdout.split("\0") if name]
    assert [name for name in names if private.search(_text(name))] == []


def _text(name: str) -> str:
    """Text of a tracked file; empty for a deleted one and for this one."""
    path = REPOSITORY / name
    if not path.is_file() or path == Path(__file__):
        return ""
    return path.read_bytes().decode("utf-8", errors="ignore")
