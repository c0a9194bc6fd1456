"""The tree keeps its rules: a test for every module, a door for every library, no private paths.

Directions of imports are import-linter's (`make lint`); what is here is what it cannot say.
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

PACKAGES = ("protocol", "server", "client")

_DRAWN = "a picture: tests/studies/camera_figures/test_main.py draws it whole"
_COST = "the study: tests/studies/accuracy_cost/test_command.py runs it whole, small"
_DEGRADED = "the study: tests/end_to_end/test_degraded.py runs it whole, small"
_RUN = "the experiment: tests/end_to_end/test_experiment.py runs it whole"

# Modules without a test file of their own, and why.
WITHOUT_TEST = {
    "protocol/errors.py": "the tree of errors: what they say is tested where they are raised",
    "server/robot/description.py": "frozen data; tests/server/config/test_robot_file.py reads it",
    "server/figures/catalogue.py": _DRAWN,
    "server/figures/cube.py": _DRAWN,
    "server/figures/faces.py": _DRAWN,
    "server/figures/meshes.py": _DRAWN,
    "server/figures/omni_frame.py": _DRAWN,
    "server/figures/polygon_error.py": _DRAWN,
    "server/figures/polygons.py": _DRAWN,
    "server/figures/rings.py": _DRAWN,
    "server/cost/pictures/detail.py": _COST,
    "server/cost/pictures/frame_rates.py": _COST,
    "server/cost/pictures/landmarks.py": _COST,
    "server/cost/pictures/legend.py": _COST,
    "server/cost/pictures/pareto.py": _COST,
    "server/cost/pictures/polygons.py": _COST,
    "server/cost/study.py": _COST,
    "server/cost/telling.py": _COST,
    "client/experiment/cost/__main__.py": "a command line: tests/end_to_end/test_cost.py runs it",
    "client/experiment/degraded/__main__.py": _DEGRADED,
    "client/experiment/degraded/study.py": _DEGRADED,
    "client/experiment/pictures/degraded.py": _DEGRADED,
    "client/__main__.py": "a command line: tests/client/landmarks/test_training.py does the work",
    "client/experiment/__main__.py": _RUN,
    "client/experiment/results.py": _RUN,
    "client/experiment/server_process.py": _RUN,
    "client/experiment/session.py": _RUN,
    "client/experiment/training_frames.py": _RUN,
    "client/experiment/pictures/classifier_view.py": _RUN,
    "client/experiment/pictures/errors.py": _RUN,
    "client/experiment/pictures/overview.py": _RUN,
    "client/experiment/pictures/style.py": _RUN,
    "client/experiment/pictures/trajectories.py": _RUN,
}

# Design, section 2: one door each. A folder stands for all modules in it.
DOORS = {
    "moderngl": ("server/render/raster",),
    "embreex": ("server/render/trace",),
    "trimesh": ("server/scene/mesh_files.py",),
    "PIL": ("server/scene/meshes.py", "server/figures"),
    "cv2": (
        *(
            "server/cost/image_error.py",
            "server/imaging/encode.py",
            "client/unwarp.py",
            "client/landmarks",
            "client/images.py",
        ),
        "client/frame.py",
    ),
    "zmq": ("server/transports/zmq_stream_socket.py", "client/stream_socket.py"),
    "msgpack": ("protocol/wire/envelope.py",),
    "matplotlib": ("server/figures/style.py", "client/experiment/pictures/style.py"),
    "rich": ("server/cost", "server/figures", "client/__main__.py", "client/experiment"),
    "socket": (
        "client/tcp.py",
        "client/control_connection.py",
        "client/robot.py",
        "client/images.py",
        "client/stream.py",
        "server/transports",
        "server/doctor/ports.py",
    ),
}
# The wire is sans-I/O: bytes and text alone.
NOT_FOR_THE_WIRE = {"socket", "asyncio", "time", "select", "selectors", "threading", "random"}


def sources(package: str) -> Iterator[tuple[str, Path]]:
    """Yield each module of a package: `server/scene/colour.py`, and where it is."""
    root = REPOSITORY / package / "src" / f"catoptra_{package}"
    for path in sorted(root.rglob("*.py")):
        yield f"{package}/{path.relative_to(root).as_posix()}", path


ALL_SOURCES = [source for package in PACKAGES for source in sources(package)]
MODULES = [name for name, _ in ALL_SOURCES if not name.endswith("/__init__.py")]


def mirror_of(module: str) -> Path:
    """Return where the test file of a module belongs."""
    place = PurePosixPath(module)
    stem = "main" if place.stem == "__main__" else place.stem
    return REPOSITORY / "tests" / place.parent / f"test_{stem}.py"


@cache
def imported(path: Path) -> frozenset[str]:
    """Return the top-level names of what a module imports, wherever in it."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names.update(alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.partition(".")[0])
    return frozenset(names)


def has_behaviour(path: Path) -> bool:
    """Return whether a module does anything: data and Protocols have no function with a body."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    functions = (n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef))
    return any(not _is_text(statement) for function in functions for statement in function.body)


def _is_text(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)


BEHAVING = [name for name, path in ALL_SOURCES if name in MODULES and has_behaviour(path)]


@pytest.mark.parametrize("module", BEHAVING)
def test_module_when_it_has_behaviour_has_a_test_file(module: str) -> None:
    assert mirror_of(module).is_file() or module in WITHOUT_TEST, (
        f"{module} has no {mirror_of(module).relative_to(REPOSITORY)}: write it, or list the "
        "module with a reason in tests/test_tree.py"
    )


def test_modules_without_a_test_are_all_there() -> None:
    assert set(WITHOUT_TEST) <= set(BEHAVING)


@pytest.mark.parametrize("library", DOORS)
def test_library_when_imported_comes_in_by_its_door(library: str) -> None:
    elsewhere = [
        name
        for name, path in ALL_SOURCES
        if library in imported(path)
        and not any(name == door or name.startswith(f"{door}/") for door in DOORS[library])
    ]
    assert elsewhere == []


def test_wire_when_imported_brings_neither_sockets_nor_clocks() -> None:
    wire = {name: path for name, path in ALL_SOURCES if name.startswith("protocol/wire/")}
    assert wire
    assert [name for name, path in wire.items() if imported(path) & NOT_FOR_THE_WIRE] == []


def test_tests_when_they_wait_do_not_sleep() -> None:
    asleep = re.compile(r"\btime\.sleep\(|asyncio\.sleep\((?!0\))")
    files = [p for p in (REPOSITORY / "tests").rglob("test_*.py") if p != Path(__file__)]
    assert files
    assert [path.name for path in files if asleep.search(path.read_text(encoding="utf-8"))] == []


def test_files_when_committed_name_no_place_of_one_machine() -> None:
    private = re.compile(r"/(?:work|home|root|Users)/[A-Za-z0-9_.]")
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=REPOSITORY, capture_output=True, text=True, check=False
    )
    if listed.returncode:
        pytest.skip("needs a git checkout to know which files are the project's")
    names = [name for name in listed.stdout.split("\0") if name]
    assert [name for name in names if private.search(_text(name))] == []


def _text(name: str) -> str:
    """Return the text of a tracked file; nothing if it is gone, or this one."""
    path = REPOSITORY / name
    if not path.is_file() or path == Path(__file__):
        return ""
    return path.read_bytes().decode("utf-8", errors="ignore")
