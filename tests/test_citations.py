"""Files and functions that comments, docstrings, shaders and documents cite exist."""

from __future__ import annotations

import ast
import io
import re
import subprocess
import tokenize
from functools import cache
from pathlib import Path

import pytest

from helpers.configs import REPOSITORY

# `frames/plan/costs.py`, `tests/measurements/face_parts.py:main`: at least one folder; without
# an ending it must name a module or folder of ours to count.
CITATION = re.compile(
    r"(?<![\w/.:<>$-])((?:[\w.-]+/)+[\w-]+(?:\.[a-z0-9]+)?)(?::(\w+))?(?![\w/<*])"
)
ENDINGS = (".py", ".frag", ".vert", ".glsl", ".md", ".ini", ".yaml", ".html", ".csv")
PACKAGES = ("protocol", "server", "client", "studies")
# What a run writes, and files of other programs.
FOREIGN = re.compile(
    r"^(out|build|dist|src|\.venv|etc|proc|dev|usr|opt)/|^https?:|^USARBot/|^UT2004/"
)
# The second line of a shader names its float64 reference: package, module, names inside.
TWIN = re.compile(r"Twin: (catoptra_\w+(?:\.\w+)+)")
# Shortest name of a module that a citation without an ending may mean: `frames/s` is a unit.
MIN_MODULE_CHARS = 3


@cache
def tracked_files() -> tuple[str, ...]:
    """Paths of all files that git tracks or would track, relative to the repository."""
    listed = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard", "-z"],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        check=False,
    )
    if listed.returncode:
        pytest.skip("needs a git checkout to know which files are the project's")
    return tuple(n for n in listed.stdout.split("\0") if n and (REPOSITORY / n).is_file())


@cache
def known_paths() -> frozenset[str]:
    """All paths by which a file may be cited: every tail of its path, with and without `.py`."""
    paths = set()
    for name in tracked_files():
        parts = name.split("/")
        for first in range(len(parts)):
            tail = "/".join(parts[first:])
            paths |= {tail, tail.removesuffix(".py")}
            for last in range(first + 1, len(parts)):
                paths.add("/".join(parts[first:last]))
    return frozenset(paths)


@cache
def package_folders() -> frozenset[str]:
    """First folders of citations without an ending that mean our own modules."""
    folders = set()
    for package in PACKAGES:
        root = REPOSITORY / package / "src" / f"catoptra_{package}"
        folders |= {path.name for path in root.rglob("*") if path.is_dir()}
    return frozenset(folders - {"__pycache__", "configs"})


@cache
def prose(path: Path) -> str:
    """Comments and docstrings of a module; all text of any other file."""
    text = path.read_text(encoding="utf-8", errors="ignore")
    if path.suffix != ".py":
        return text
    parts = [
        token.string
        for token in tokenize.generate_tokens(io.StringIO(text).readline)
        if token.type == tokenize.COMMENT
    ]
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            parts.append(str(node.value.value))
    return "\n".join(parts)


def dead_citations(text: str) -> list[str]:
    """Paths in a text that name no file of the repository."""
    dead = []
    for path, _ in CITATION.findall(text):
        name = re.sub(r"^(\.\./)+", "", path.rstrip("."))
        if FOREIGN.search(name) or name in known_paths():
            continue
        *folders, stem = name.split("/")
        is_module = {*folders[:1]} & package_folders() and len(stem) >= MIN_MODULE_CHARS
        if name.endswith(ENDINGS) or ("." not in stem and is_module):
            dead.append(name)
    return dead


CITING = (".py", ".md", ".frag", ".vert", ".glsl", ".ini", ".toml", ".yaml")


def citing_files() -> list[str]:
    """Files whose prose is checked; data of tests cites nothing."""
    return [
        name
        for name in tracked_files()
        if name.endswith(CITING) and not name.startswith("tests/conformance/data")
    ]


def dead_citations_of(path: Path) -> list[str]:
    """Paths in the prose of a file that name no file of the repository."""
    # Most files have none in their code either: to take a module apart costs ten times as much.
    text = path.read_text(encoding="utf-8", errors="ignore")
    return dead_citations(prose(path)) if dead_citations(text) else []


def test_every_cited_file_exists() -> None:
    dead = {
        name: found for name in citing_files() if (found := dead_citations_of(REPOSITORY / name))
    }
    assert dead == {}


def test_citation_when_its_file_is_missing_is_found() -> None:
    gone = "measured in tests/measurements/gone.py, see render/trace/gone and README.md"
    assert dead_citations(gone) == ["tests/measurements/gone.py", "render/trace/gone"]
    assert dead_citations("tests/test_citations.py, render/trace, out/cost/steps.png, 1/2") == []


def dead_twins(text: str) -> list[str]:
    """Twins named by a text whose module, or a name in it, does not exist."""
    return [twin for twin in TWIN.findall(text) if not twin_exists(twin)]


def twin_exists(twin: str) -> bool:
    """Whether `catoptra_server.world.shading.irradiance` is a function of an existing module."""
    package, *parts = twin.split(".")
    root = REPOSITORY / package.removeprefix("catoptra_") / "src" / package
    for length in range(len(parts), 0, -1):
        module = root.joinpath(*parts[:length]).with_suffix(".py")
        if module.is_file():
            text = module.read_text(encoding="utf-8")
            # A function, a class, or a field of a dataclass.
            forms = [rf"\b(def|class) {name}\b|^ +{name}:" for name in parts[length:]]
            return all(re.search(form, text, re.MULTILINE) for form in forms)
    return False


def test_every_twin_exists() -> None:
    shaders = [name for name in tracked_files() if name.endswith((".frag", ".vert", ".glsl"))]
    ours = [name for name in shaders if name.startswith("server/")]
    assert ours
    dead = {name: d for name in ours if (d := dead_twins(prose(REPOSITORY / name)))}
    assert dead == {}


def test_twin_when_missing_is_found() -> None:
    assert dead_twins("// Twin: catoptra_server.world.gone.f.") == ["catoptra_server.world.gone.f"]
    assert dead_twins("// Twin: catoptra_server.world.shading.gone.") != []
