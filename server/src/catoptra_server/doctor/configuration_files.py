"""Check of configuration files: each is read as by the server, meshes and textures included."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

from catoptra_protocol.errors import CatoptraError
from catoptra_server.config.ini_file import IniFile
from catoptra_server.config.robot_file import read_robots
from catoptra_server.config.world_file import read_world
from catoptra_server.doctor.finding import Finding, fault, ok, warning
from catoptra_server.world.scene_mesh import build_scene


def check_configurations(robots: Iterable[Path], worlds: Iterable[Path]) -> Iterator[Finding]:
    """Yield the findings of each file: an error, or the content and the unknown keys."""
    for path in robots:
        yield from _check_file("robot", path, _read_robot_names)
    for path in worlds:
        yield from _check_file("world", path, _read_world_summary)


def _check_file(
    kind: str, path: Path, read: Callable[[Path], tuple[str, IniFile]]
) -> Iterator[Finding]:
    topic = f"{kind} {path.stem}"
    try:
        summary, file = read(path)
    except CatoptraError as error:
        remedy = "correct that line; configs/README.md lists the values of each key"
        yield fault(topic, str(error), remedy=remedy)
        return
    yield ok(topic, summary)
    # A warning outside our sections: real files carry keys of the engine, and the server starts.
    for name in file.unknown_names():
        message, remedy = f"{name.where}: {name.describe()}", "correct its spelling, or remove it"
        finding = fault if name.is_error else warning
        yield finding(topic, message, remedy=remedy)


def _read_robot_names(path: Path) -> tuple[str, IniFile]:
    robots, file = read_robots(path)
    return ", ".join(robot.class_name for robot in robots), file


def _read_world_summary(path: Path) -> tuple[str, IniFile]:
    world, file = read_world(path)
    # Only the scene loads meshes and textures, where most errors of a world file are.
    return f"{world.name}, {len(build_scene(world))} triangles", file
