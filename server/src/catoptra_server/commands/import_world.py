"""`catoptra-server import WORLD --models DIR --out FILE.ini`: a world of Gazebo as a world file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from catoptra_protocol.command_line import CommandParser
from catoptra_protocol.errors import CatoptraError
from catoptra_server.config.sdf_world import import_sdf
from catoptra_server.config.world_file import format_start, read_world
from catoptra_server.simulation.floor_plan import find_start
from catoptra_server.world.scene_mesh import build_scene

# A world that lacks its models lists each of them.
_MAX_LISTED = 40


def main(arguments: Sequence[str]) -> int:
    """Write the world file and list what it leaves out."""
    parser = CommandParser(
        "catoptra-server import",
        "Write a world of Gazebo (SDF) as a world file: models, includes, poses, "
        "shapes, materials and lights. Meshes and textures stay where they are.",
    )
    parser.add_argument("world", type=Path, metavar="WORLD", help="an SDF file")
    parser.add_argument("--models", type=Path, action="append", default=[], metavar="DIR",
        help="folder of the models that model:// names; may be repeated; no file outside of these "
        "and the world's folder is read")  # fmt: skip
    parser.add_argument("--out", type=Path, required=True, metavar="FILE.ini",
        help="world file to write")  # fmt: skip
    parsed = parser.parse_args(arguments)
    if parsed.out.suffix.lower() != ".ini":
        parser.error(f"--out is the name of a world file, which ends with .ini, not {parsed.out}")
    for folder in parsed.models:
        if not folder.is_dir():
            parser.error(f"--models is a folder; there is none of the name {folder}")
    world = import_sdf(parsed.world, parsed.models, parsed.out.parent)
    parsed.out.write_text(world.text, encoding="utf-8")
    start = _add_start(parsed.out, world.text)
    print(f"{parsed.out}: {world.num_items} shapes, {world.num_lights} lights, {start}")
    left_out = sorted(world.left_out.items())
    if left_out:
        print("left out:")
    for name, count in left_out[:_MAX_LISTED]:
        print(f"  {count:5} {name}")
    if num_further := len(left_out[_MAX_LISTED:]):
        print(f"  and {num_further} further kinds")
    return 0


def _add_start(path: Path, text: str) -> str:
    """Add a start to a world file, and describe it; a world that cannot be loaded has none."""
    try:
        start = find_start(build_scene(read_world(path)[0], has_texels=False))
    except CatoptraError as error:
        return f"no start: {error}"
    if start is None:
        return "no start: there is no free floor"
    path.write_text(text + format_start(*start) + "\n", encoding="utf-8")
    return "the start Start at {:g}, {:g} m".format(*start)
