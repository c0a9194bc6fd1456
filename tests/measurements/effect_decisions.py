"""What does it cost to decide which effects a frame needs, and is anything built in vain?

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/effect_decisions.py

Prints, for the field, the corridor, 60 000 and a million triangles, the processor's microseconds a
frame of the summary and of the decision of all kinds of effects, at their defaults: standing, and
the mean and the most of a drive of 400 ticks at 0.5 m/s; then how many summaries that drive had.
Decided by it: the fan of the tree and how many of its boxes are opened at once
(bounds/ring_distance_bvh.py), the sides of cells (bounds/distance_bound_cache.py), and that bounds are kept by what
they asked for.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Sequence

from drive_path import drive_path
from effect_costs import default_settings
from scenes import CORRIDOR, make_camera, make_worlds_with_million_triangles

from catoptra_server.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.config.world_file import read_world
from catoptra_server.effects.effect import EffectMode
from catoptra_server.effects.effect_plan import plan_effects
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.scene.scene_mesh import build_scene

ALL = default_settings(EffectMode.AUTO)
CAMERA = make_camera()
TICKS = 400


def measure_us(
    summaries: SceneSummarizer, camera_states: Sequence[CameraState]
) -> tuple[list[float], list[float], set[SceneSummary]]:
    """Return the times of summaries and of decisions, frame by frame, and what they were of."""
    of_summary, of_decision, known = [], [], set()
    for exposure in camera_states:
        begin = time.process_time()
        summary = summaries.summarize(exposure, CAMERA)
        between = time.process_time()
        plan_effects(ALL, summary, CAMERA)
        of_summary.append(1e6 * (between - begin))
        of_decision.append(1e6 * (time.process_time() - between))
        known.add(summary)
    return of_summary, of_decision, known


def main() -> None:
    names = {**make_worlds_with_million_triangles(), "corridor": read_world(CORRIDOR)[0]}
    print("            standing: summary, decision; driving: mean and most of each; summaries")
    for name, world in names.items():
        summaries = SceneSummarizer(build_scene(world), world)
        way = drive_path(name, TICKS)
        measure_us(summaries, way[:1])  # what is found once for all
        still = [statistics.median(times) for times in measure_us(summaries, way[:1] * 100)[:2]]
        *moving, known = measure_us(summaries, way)
        told = "".join(f"{statistics.mean(times):9.0f}{max(times):9.0f}" for times in moving)
        print(f"  {name:<9}{still[0]:9.0f}{still[1]:9.0f}{told}{len(known):6d}", flush=True)


if __name__ == "__main__":
    main()
