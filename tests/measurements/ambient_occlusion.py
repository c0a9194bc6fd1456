"""Cost of ambient occlusion: the baking, and frames beside those of the same world without it.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/ambient_occlusion.py

Prints, for each shipped world, processor seconds of the baking (median of five), the grids and the
nodes that are dark, and the ratio of processor times with and without the map, rendered in turns
through `ViewCache`: a still clean frame of 640 x 640 px at 2 x 2 samples, and the shipped real
camera in motion.
"""

from __future__ import annotations

import statistics
import time
from dataclasses import replace

import numpy as np
from effect_frame_times import DRIVING, Bench, make_settings
from interleaved import median_ms

from catoptra_server.commands import explain
from catoptra_server.render.trace.occlusion.baking import bake_occlusion
from catoptra_server.render.trace.ray_caster import commit_ray_caster
from catoptra_server.runtime.memory import count_processors
from catoptra_server.world.scene_mesh import SceneMesh

WORLDS = ("four_legged_2006", "corridor", "rescue", "warehouse")
STILL = explain.ZERO_VELOCITY
_ROUNDS = 15


def time_baking(scene: SceneMesh) -> float:
    """Median processor seconds of the baking."""
    caster, times = commit_ray_caster(scene), []
    for _ in range(5):
        begin = time.process_time()
        bake_occlusion(scene, caster, threads=count_processors())
        times.append(time.process_time() - begin)
    return statistics.median(times)


def main() -> None:
    """Print a line for each world."""
    for world in WORLDS:
        lit, open_sky = Bench(world, "trace"), Bench(world, "trace", is_occluded=False)
        occlusion = lit.startup.scene.occlusion
        if occlusion is None:
            print(f"{world:16} nothing is occluded, or no light of the sky")
            continue
        seconds = time_baking(replace(lit.startup.scene, occlusion=None))
        clean = make_settings(())
        draws = {
            "still on": lit.make_draw(clean, STILL),
            "still off": open_sky.make_draw(clean, STILL),
            "moving on": lit.make_real_draw(DRIVING),
            "moving off": open_sky.make_real_draw(DRIVING),
        }
        ms = {name: cpu for name, (_, cpu) in median_ms(draws, rounds=_ROUNDS).items()}
        dark = np.count_nonzero(occlusion.texels != 255)
        print(
            f"{world:16} baked in {seconds:.2f} s, {len(occlusion.bounds)} grids, {dark} dark "
            f"nodes; still {ms['still off']:.1f} -> {ms['still on']:.1f} ms "
            f"({ms['still on'] / ms['still off']:.2f}), moving {ms['moving off']:.1f} -> "
            f"{ms['moving on']:.1f} ms ({ms['moving on'] / ms['moving off']:.2f})",
            flush=True,
        )


if __name__ == "__main__":
    main()
