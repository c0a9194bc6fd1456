"""What triangles out of sight cost a moving camera, around four former limits of their number.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/triangle_limits.py

For each former limit, with triangles just below, just above and ten times above it in a ball that
stands behind a wall, near the camera's way: the processor milliseconds of a frame of 360 x 360 px,
drawn in turns along one drive with all bounds that shadows, blur and defocus call for, and as a
ratio to the first; the share of the summary of the scene in it; the processor seconds of the start,
occlusion map, bounds and first frame included; the loss by shadows in grey levels, and the mean
factor of ambient occlusion of the ball. No number may jump with the triangles, and the first must
stay within 10 %; a start takes as long as there are triangles.

Beyond were: no occlusion of small triangles (8000 in render/trace/occlusion/surface_grids.py),
shadows whatever the scene (100 000 in effects/bounds/shadow_bounds.py), bounds of a query of
distances as of whole boxes (2048 in a cell, 16 384 at a point, in effects/bounds/distances.py).
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

from effect_frame_times import make_settings
from interleaved import median_ms
from scenes import make_camera

from catoptra_protocol.optics.transforms import Pose
from catoptra_server.effects.bounds.light_loss import grey_level_change
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.frames.frame import ViewRequest
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.renderers import RendererPool, choose_renderer
from catoptra_server.frames.views import ViewCache
from catoptra_server.render.renderer import RenderSettings
from catoptra_server.render.trace.occlusion.occlusion_cache import find_occlusion
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import (
    Box,
    DirectionalLight,
    HemisphereLight,
    Item,
    Material,
    Rectangle,
    SphereBand,
    Twist,
    World,
)

LIMITS = {"occlusion": 8000, "shadows": 100_000, "cell": 2048, "query": 16_384}
SHARES = (0.95, 1.05, 10.0)
ROUNDS = 60
CAMERA = make_camera(360)
SPEC = OmniCameraSpec(
    CAMERA,
    RenderSettings(samples=1),
    make_settings(("Shadows", "RollingShutter", "MotionBlur", "DefocusByDepth", "Defocus")),
)


def make_world(triangles: int, *, ambient_occlusion: bool) -> World:
    """A floor, a wall, and behind the wall a ball; nothing casts a shadow."""
    rings = max(8, round(math.sqrt(triangles / 4.0)))
    shape = SphereBand(0.3, 0.0, math.radians(179.0), 2 * rings, rings)
    grey = Material((0.5, 0.5, 0.5))
    items = [
        Item("floor", Rectangle((8.0, 8.0)), Pose.identity(), grey),
        Item("wall", Box((0.05, 3.0, 1.2)), Pose.from_rpy((1.2, 0.0, -0.6)), grey),
        Item("ball", shape, Pose.from_rpy((1.6, 0.0, -0.4)), grey),
    ]
    lights = (
        HemisphereLight((0.4, 0.4, 0.4), (0.3, 0.3, 0.3)),
        DirectionalLight((0.6, 0.0, 0.8), (0.4, 0.4, 0.4)),
    )
    # Occluders of light from the sky are those of lamps.
    casting = tuple(replace(one, casts_shadows=ambient_occlusion) for one in items)
    return World("limits", casting, lights=lights, ambient_occlusion=ambient_occlusion)


def drive() -> Iterator[CameraState]:
    """States along the wall, forth and back."""
    step = 0
    while True:
        y = 1.2 * math.sin(0.05 * step)
        pose = Pose.from_rpy((0.3, y, -0.6), (0.0, 0.0, 0.01 * step))
        twist = Twist((0.5, 0.0, 0.0), (0.0, 0.0, 0.2))
        yield CameraState(pose, twist=twist)
        step += 1


class Variant:
    """One world with its views."""

    def __init__(self, triangles: int, *, ambient_occlusion: bool) -> None:
        begin = time.process_time()
        world = make_world(triangles, ambient_occlusion=ambient_occlusion)
        scene = build_scene(world)
        if ambient_occlusion:
            scene = replace(scene, occlusion=find_occlusion(scene, None))
        self.scene = scene
        self.summaries = SceneSummarizer(scene, world)
        self.views = ViewCache(
            RenderPlanner(RendererPool(choose_renderer("trace", scene, world))), self.summaries
        )
        self.draw = self.make_draw()
        self.draw()
        self.start_s = time.process_time() - begin

    def make_draw(self) -> Callable[[], object]:
        """Function that draws the next state of a drive."""
        states = drive()
        return lambda: self.views.render(ViewRequest(SPEC, next(states)))

    def measure_summary_ms(self) -> float:
        """Mean processor time of a summary along a drive of its own."""
        states, times = drive(), []
        summaries = SceneSummarizer(self.scene, self.summaries._world)
        summaries.summarize(next(states), CAMERA)
        for _ in range(ROUNDS):
            state = next(states)
            begin = time.process_time()
            summaries.summarize(state, CAMERA)
            times.append(time.process_time() - begin)
        return 1e3 * statistics.mean(times)

    def describe_result(self) -> str:
        """Loss by shadows, and mean factor of the ball."""
        loss = self.summaries.summarize(next(drive()), CAMERA).max_shadow_loss
        factor = float(self.scene.smallest_sky_factors(slice(14, None)).mean())
        return f"shadows {grey_level_change(loss):6.2f} levels, factor of the ball {factor:.3f}"


def main() -> None:
    for name, limit in LIMITS.items():
        counts = [int(share * limit) for share in SHARES]
        variants = {
            str(count): Variant(count, ambient_occlusion=name == "occlusion") for count in counts
        }
        draws = {count: variant.draw for count, variant in variants.items()}
        frame_ms = {count: cpu for count, (_, cpu) in median_ms(draws, rounds=ROUNDS).items()}
        first = frame_ms[str(counts[0])]
        for count, variant in variants.items():
            print(
                f"{name:9} {count:>8} triangles: frame {frame_ms[count]:6.2f} ms "
                f"({frame_ms[count] / first:.3f}), summary {variant.measure_summary_ms():6.3f} ms, "
                f"start {variant.start_s:6.2f} s, {variant.describe_result()}",
                flush=True,
            )
            variant.views.close()


if __name__ == "__main__":
    main()
