"""Names of the sources: a class once, a module once, functions by verbs instead of participles."""

from __future__ import annotations

import ast
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

from helpers.configs import REPOSITORY

DISTRIBUTIONS = ("protocol", "server", "client", "studies")
# One idea on both sides of the wire: an image with its metadata.
SHARED_CLASSES = {"Frame"}
# `_blurred`, `camera_named`: a name of a result where a call should say its action.
PARTICIPLE = re.compile(
    r"^_?(\w+_)?(told|drawn|seen|known|met|kept|given|taken|gone|shown|made|\w{3,}ed)$"
)
# Verbs and nouns with the same ending.
NO_PARTICIPLES = {"seed", "speed", "need", "feed", "embed", "exceed", "proceed", "spread_speed"}
# Callbacks of asyncio's protocols, whose names are not ours.
CALLBACKS = {
    *("connection_made", "connection_lost"),
    *("buffer_updated", "data_received", "eof_received"),
}


def source_files() -> Iterator[Path]:
    """Yield every module of the four distributions."""
    for distribution in DISTRIBUTIONS:
        yield from sorted((REPOSITORY / distribution / "src").rglob("*.py"))


def repeated(named_files: Iterable[tuple[str, Path]]) -> dict[str, list[str]]:
    """Names that occur more than once, each with its files."""
    files = defaultdict(list)
    for name, path in named_files:
        files[name].append(path.relative_to(REPOSITORY).as_posix())
    return {name: paths for name, paths in files.items() if len(paths) > 1}


Definition = ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef


def definitions(source: str) -> list[Definition]:
    """All classes, functions and methods of a module, nested ones too."""
    return [node for node in ast.walk(ast.parse(source)) if isinstance(node, Definition)]


@cache
def definitions_of(path: Path) -> list[Definition]:
    return definitions(path.read_text(encoding="utf-8"))


def defined_classes(path: Path) -> list[str]:
    """Names of all classes that a module defines."""
    return [node.name for node in definitions_of(path) if isinstance(node, ast.ClassDef)]


def participles(defined: Iterable[Definition]) -> list[str]:
    """Functions and methods, other than properties, that a participle names."""
    return [
        node.name
        for node in defined
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        and PARTICIPLE.match(node.name)
        and node.name.strip("_") not in NO_PARTICIPLES | CALLBACKS
        and not any("property" in ast.unparse(line) for line in node.decorator_list)
    ]


def test_class_names_occur_once_in_the_repository() -> None:
    classes = ((name, path) for path in source_files() for name in defined_classes(path))
    assert {n: p for n, p in repeated(classes).items() if n not in SHARED_CLASSES} == {}


def test_module_names_occur_once_in_a_distribution() -> None:
    modules = (
        (f"{path.relative_to(REPOSITORY).parts[0]}: {path.stem}", path)
        for path in source_files()
        if not path.stem.startswith("__")
    )
    assert repeated(modules) == {}


def test_functions_are_not_named_by_participles() -> None:
    found = {
        path.relative_to(REPOSITORY).as_posix(): names
        for path in source_files()
        if (names := participles(definitions_of(path)))
    }
    assert found == {}


def test_participle_when_it_names_a_function_is_found() -> None:
    source = "def _blurred(): ...\nclass A:\n  def camera_named(self): ...\n  def speed(self): ..."
    assert participles(definitions(source)) == ["_blurred", "camera_named"]
    assert participles(definitions("class A:\n  @property\n  def is_needed(self): ...")) == []
