"""Mesh files that others made, each loaded as a world's mesh: prints docs/MODELS.md.

Nothing is timed. Whatever is no `ConfigError` is a fault of ours, and its traceback is printed,
too. Run with archives that `pip download --no-deps` fetched:

    PYTHONPATH=tests python -m measurements.foreign_models genesis_world-*.whl ... > docs/MODELS.md
"""

from __future__ import annotations

import logging
import re
import sys
import tarfile
import tempfile
import traceback
import zipfile
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from catoptra_protocol.errors import ConfigError
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.world_file import MESH_SUFFIXES
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Item, MeshFile, World

_HEAD = """\
# Mesh files of others

Packages on PyPI that contain mesh files, and what becomes of each file as a mesh of a world;
written by `python -m measurements.foreign_models`. Source distributions without models: trimesh
5.2.0, 4.0.0 and 3.9.0, pygltflib, pycollada, PyWavefront, panda3d-gltf.

* **whole**: as the format means it. **with losses**: a message names what is not drawn.
* **without textures**: the file names one, or a library of materials, that the package does not
  have. That is an error which names it; `MissingTextures=grey` draws the rest.
* **rejected**: in one line. **fault**: by an exception that is none of ours.
"""
_RESULTS = ("whole", "with losses", "without textures", "rejected", "fault")


class _Messages(logging.Handler):
    """Messages of one file."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.texts: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.texts.append(record.getMessage())


def _unpack(archive: Path, folder: Path) -> None:
    if archive.suffix in (".whl", ".zip"):
        with zipfile.ZipFile(archive) as file:
            file.extractall(folder)
    else:
        with tarfile.open(archive) as file:
            file.extractall(folder, filter="data")


def _load(shape: MeshFile, messages: _Messages) -> tuple[str, list[str]]:
    """Result of a file, and the reasons."""
    messages.texts.clear()
    try:
        build_scene(World(shape.path.name, (Item("mesh", shape, Pose.identity(), None),)))
    except ConfigError as error:
        if "MissingTextures" in str(error) and not shape.has_optional_textures:
            _, reasons = _load(replace(shape, has_optional_textures=True), messages)
            return "without textures", reasons
        return "rejected", [error.expected]
    except Exception:  # what a file must not cause
        traceback.print_exc()
        return "fault", [traceback.format_exc().splitlines()[-1]]
    return ("with losses" if messages.texts else "whole"), list(messages.texts)


def _generalize(reason: str, folder: Path) -> str:
    """A reason without the names and numbers of one file."""
    reason = re.sub(r"^\S*/\S+: ", "", reason.replace(str(folder), ""))
    reason = re.sub(r"^missing .*: materials", "missing library of materials: it", reason)
    reason = re.sub(r"^missing .*: material .* is", "missing texture: the material is", reason)
    return re.sub(r"\d[\d.]*", "N", re.sub(r"'[^']*'|\"[^\"]*\"|\S+/\S+", "...", reason))[:160]


def _list_models(folder: Path) -> Iterator[Path]:
    return (path for path in sorted(folder.rglob("*")) if path.suffix.lower() in MESH_SUFFIXES)


def main() -> None:
    """Print the tables."""
    messages = _Messages()
    logging.getLogger().addHandler(messages)
    counts: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    reasons: dict[tuple[str, str], list[str]] = defaultdict(list)
    for archive in map(Path, sys.argv[1:]):
        with tempfile.TemporaryDirectory() as name:
            _unpack(archive, Path(name))
            package = "-".join(archive.name.split("-")[:2])
            for path in _list_models(Path(name)):
                shape = MeshFile(path)
                result, texts = _load(shape, messages)
                counts[package, path.suffix[1:].lower()][result] += 1
                for text in {_generalize(text, Path(name)) for text in texts}:
                    reasons[result, text].append(path.name)
    print(_HEAD)
    print("| package | format | files | " + " | ".join(_RESULTS) + " |")
    print("|---|---|---|" + "---|" * len(_RESULTS))
    for (package, suffix), found in sorted(counts.items()):
        row = " | ".join(str(found[result]) for result in _RESULTS)
        print(f"| {package} | {suffix} | {found.total()} | {row} |")
    print("\n`N` stands for numbers.\n\n| result | files | reason | example |\n|---|---|---|---|")
    for (result, text), names in sorted(reasons.items()):
        print(f"| {result} | {len(names)} | {text} | {names[0]} |")


if __name__ == "__main__":
    main()
