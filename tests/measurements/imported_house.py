"""A house of Gazebo, imported whole: placements, time and memory of each step.

69 mesh files of COLLADA in centimetres, 146 000 triangles, 113 placements, 87 textures of 1024 px.
Placements are compared with the arithmetic of `helpers/gazebo_house.py`, which knows nothing of the
importer. Then servers: of the house, by both renderers, and of one and of 113 walls of one file,
until their first frame. Run with

    PYTHONPATH=tests python -m measurements.imported_house
"""

from __future__ import annotations

import os
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from catoptra_client.robot_client import RobotClient
from catoptra_server.config.sdf_world import import_sdf
from catoptra_server.config.world_file import read_world
from catoptra_server.render.trace.kernel.kernel_engine import KernelEngine
from catoptra_server.world.scene_mesh import build_scene
from cost.served_process import (
    FULL_REQUEST,
    CountedServer,
    connect_watchers,
    read_ports,
    start_process,
)
from helpers.gazebo_house import write_house
from helpers.memory import resident_mb

_NUM_MODELS, _NUM_PLACEMENTS, _NUM_SEGMENTS, _NUM_TEXTURES = 69, 113, 162, 87


def main() -> None:
    """Print a line for each step."""
    suffix = sys.argv[1] if len(sys.argv) > 1 else ".dae"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        placements = write_house(
            folder,
            num_models=_NUM_MODELS,
            num_placements=_NUM_PLACEMENTS,
            num_segments=_NUM_SEGMENTS,
            suffix=suffix,
            num_textures=_NUM_TEXTURES if suffix == ".dae" else 0,
        )
        begin_s = time.process_time()
        imported = import_sdf(folder / "arena.world", [folder / "models"], folder)
        print(f"import: {time.process_time() - begin_s:.2f} s, left out: {imported.left_out}")
        (folder / "house.ini").write_text(imported.text)
        begin_s = time.process_time()
        world, _ = read_world(folder / "house.ini")
        scene = build_scene(world)
        print(f"scene: {time.process_time() - begin_s:.2f} s, {len(scene)} triangles")
        names = [item.partition("/")[0] for item in scene.item_names]
        worst_m = 0.0
        for placement in placements:
            index = names.index(placement.name)
            corners = scene.corners[scene.item_index == index].reshape(-1, 3)
            for point in placement.vertices[:: max(len(placement.vertices) // 32, 1)]:
                gap_m = float(np.linalg.norm(corners - point, axis=1).min())
                worst_m = max(worst_m, gap_m)
        begin_s = time.process_time()
        engine = KernelEngine(scene, world, threads=1, scene_lights=world.lights)
        mib = resident_mb(os.getpid())
        print(f"trace: {time.process_time() - begin_s:.2f} s, resident memory {mib:.0f} MiB")
        engine.close()
        print(f"placements: {len(placements)}, largest distance {1000.0 * worst_m:.6f} mm")
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        print(f"peak memory {peak / 1024:.0f} MiB")
        for renderer in ("trace", "raster"):
            print(f"house, {renderer}: {_serve(folder / 'house.ini', renderer)}")
        for number in (1, 113):
            walls = _write_walls(folder / f"walls_{number}", number, suffix)
            print(f"walls, {number}: {_serve(walls, 'trace')}")


def _write_walls(folder: Path, number: int, suffix: str) -> Path:
    """World file of placements of one textured wall of 768 triangles."""
    folder.mkdir()
    counts = {"num_models": 1, "num_placements": number, "num_segments": 96}
    write_house(folder, **counts, suffix=suffix, num_textures=1 if suffix == ".dae" else 0)
    path = folder / "walls.ini"
    path.write_text(import_sdf(folder / "arena.world", [folder / "models"], folder).text)
    return path


def _serve(world: Path, renderer: str) -> str:
    """Time from the start of a server to its first frame, and its memory then."""
    begin_s = time.monotonic()
    command = [sys.executable, "-m", "catoptra_server"]
    with start_process(command, "--world", str(world), "--renderer", renderer) as process:
        server = CountedServer(process, read_ports(process))
        with RobotClient.connect(port=server.control_port, timeout_s=60.0) as client:
            client.spawn("USARBot.OmniP2AT", location_m=(0.0, 0.0, 0.0))
            with connect_watchers(server, FULL_REQUEST) as (watcher,):
                watcher.receive_frame()
                used = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
                processor_s = (int(used[11]) + int(used[12])) / os.sysconf("SC_CLK_TCK")
                first_s = time.monotonic() - begin_s
                # What a server loads once it serves is memory, too.
                time.sleep(1.0)
                memory_mib = resident_mb(process.pid)
    return f"first frame {first_s:.2f} s, {processor_s:.2f} s of processors, {memory_mib:.0f} MiB"


if __name__ == "__main__":
    main()
