"""Cost of the decision which effects a frame needs.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/effect_decisions.py

Prints, for the field, the corridor, 60 000 and a million triangles, the processor microseconds per
frame of the scene summary and of the decision on all kinds of effects with default parameters: at
rest, and mean and maximum of a drive of 400 ticks at 0.5 m/s; then the number of distinct summaries
of the drive. Decisions: the branching of the tree (world/triangles.py), the number of boxes that
are opened at once and the size of cells (effects/bounds/distances.py), and bounds that are cached
by the fields that a criterion reads (effects/effect_plan.py).
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Sequence

from drive_path import drive_path
from effect_costs import default_settings
from scenes import CORRIDOR, make_camera, make_worlds_with_million_triangles

from catoptra_server.config.world_file import read_world
from catoptra_server.effects import EffectMode, SceneSummary
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.effect_plan import plan_effects
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene

ALL = default_settings(EffectMode.AUTO)
CAMERA = make_camera()
TICKS = 400


def measure_us(
    summaries: SceneSummarizer, camera_states: Sequence[CameraState]
) -> tuple[list[float], list[float], set[SceneSummary]]:
    """Times of summaries and of decisions by frame, microseconds, and the distinct summaries."""
    summary_us, decision_us, distinct = [], [], set()
    for camera_state in camera_states:
        begin = time.process_time()
        summary = summaries.summarize(camera_state, CAMERA)
        between = time.process_time()
        plan_effects(ALL, summary, CAMERA)
        summary_us.append(1e6 * (between - begin))
        decision_us.append(1e6 * (time.process_time() - between))
        distinct.add(summary)
    return summary_us, decision_us, distinct


def main() -> None:
    names = {**make_worlds_with_million_triangles(), "corridor": read_world(CORRIDOR)[0]}
    print("            at rest: summary, decision; in motion: mean and maximum of each; summaries")
    for name, world in names.items():
        summaries = SceneSummarizer(build_scene(world), world)
        path = drive_path(name, TICKS)
        measure_us(summaries, path[:1])  # fills caches that hold for all frames
        at_rest = [statistics.median(times) for times in measure_us(summaries, path[:1] * 100)[:2]]
        *moving, distinct = measure_us(summaries, path)
        columns = "".join(f"{statistics.mean(times):9.0f}{max(times):9.0f}" for times in moving)
        print(
            f"  {name:<9}{at_rest[0]:9.0f}{at_rest[1]:9.0f}{columns}{len(distinct):6d}", flush=True
        )


if __name__ == "__main__":
    main()
