"""Cost of the cube faces in OpenGL: texture format, samples, triangle clusters, waits per stage.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/raster_faces.py

Prints the median and the minimum milliseconds of the faces of a 640 x 640 px image in two scenes.
Decisions: RGBA16F in render/raster/passes.py, 96 triangles in world/triangles.py, the wait
after each stage in render/renderer.py, and the plain clear in render/raster/face_pass.py.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from functools import partial
from unittest import mock

import moderngl
import numpy as np
from scenes import CAMERA_STATE, make_camera, make_worlds

from catoptra_server.frames.plan.faces import face_regions
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.frames.renderers import create_renderer
from catoptra_server.render.projection.atlas import GUARD_TEXELS, Atlas, pack_atlas
from catoptra_server.render.raster import open_device, scene_buffers
from catoptra_server.render.raster.device import ShaderPrograms, make_depth_buffer
from catoptra_server.render.raster.scene_buffers import SceneBuffers
from catoptra_server.render.renderer import PerPixel, RenderSettings, StageClock
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.triangles import TRIANGLES_PER_CLUSTER, make_clusters
from catoptra_server.world.world_description import World

FRAMES = 25
GL_FRAMEBUFFER_SRGB = 0x8DB9
GL_SRGB8_ALPHA8 = 0x8C43
FACE_PX = 672


def measure_ms(draw: Callable[[], object], finish: Callable[[], None]) -> str:
    times = []
    for _ in range(FRAMES + 2):
        begin = time.perf_counter()
        draw()
        finish()
        times.append(1e3 * (time.perf_counter() - begin))
    return f"{statistics.median(times[2:]):8.1f}{min(times):8.1f}"


def draw_faces(scene: SceneBuffers, atlas: Atlas, target: moderngl.Framebuffer) -> None:
    """Render the faces as FacePass does, into any target."""
    pose = CAMERA_STATE.world_from_mirror
    viewpoint = pose.translation - scene.origin
    scene.plain.set_frame(viewpoint)
    target.clear(*scene.background, 1.0, depth=0.0)
    pieces = scene.split_large_triangles(viewpoint)
    target.use()
    for cell in atlas.cells:
        target.viewport = cell.viewport
        x, y, w = clip = cell.clip_from_mirror @ pose.rotation.T
        visible = scene.clusters.in_front_of_planes(
            np.stack((w + x, w - x, w + y, w - y, w)), viewpoint
        )
        scene.plain.batches.draw(clip, visible, pieces)
    target.viewport = (0, 0, atlas.width, atlas.height)


def measure_storage(context: moderngl.Context, scene: SceneBuffers) -> None:
    """Compare targets: format, multisampling, twice the width."""
    for name, kind, srgb, samples, scale in (
        ("RGBA16F", {"dtype": "f2"}, False, 0, 1),
        ("RGBA32F", {"dtype": "f4"}, False, 0, 1),
        ("SRGB8_ALPHA8", {"internal_format": GL_SRGB8_ALPHA8}, True, 0, 1),
        ("RGBA8, linear: too coarse", {}, False, 0, 1),
        ("RGBA16F, 4 samples and resolve", {"dtype": "f2"}, False, 4, 1),
        ("RGBA16F, twice as wide", {"dtype": "f2"}, False, 0, 2),
    ):
        atlas = make_atlas(scale * FACE_PX)
        size = (atlas.width, atlas.height)
        colour = context.texture(size, 4, samples=samples, **kind)
        target = context.framebuffer([colour], make_depth_buffer(context, size, samples))
        resolved = context.framebuffer([context.texture(size, 4, dtype="f2")])
        context.enable_only(moderngl.DEPTH_TEST)
        context.depth_func = ">"
        (context.enable_direct if srgb else context.disable_direct)(GL_FRAMEBUFFER_SRGB)

        def draw(target: moderngl.Framebuffer = target, samples: int = samples) -> None:
            draw_faces(scene, atlas, target)  # noqa: B023 - called at once
            if samples:
                context.copy_framebuffer(resolved, target)  # noqa: B023 - called at once

        print(f"  {name:<36}{measure_ms(draw, context.finish)}")
    context.disable_direct(GL_FRAMEBUFFER_SRGB)


def chunk_sizes(world: World) -> None:
    """Compare cluster sizes by whole frames."""
    for size in (32, TRIANGLES_PER_CLUSTER, 256, 1024, 4096, 10**9):
        with mock.patch.object(scene_buffers, "make_chunks", partial(make_clusters, size=size)):
            print(f"  {f'chunks of {size}':<36}{measure_frame(world)}")


def measure_waiting(world: World) -> None:
    """Compare a frame with a wait after each stage to one that is only queued."""
    print(f"  {'frame, waiting after each stage':<36}{measure_frame(world)}")
    with mock.patch.object(StageClock, "mark", return_value=None):
        print(f"  {'frame, never waiting':<36}{measure_frame(world)}")


def measure_frame(world: World) -> str:
    renderer = create_renderer(RendererKind.RASTER, build_scene(world), world)
    settings = RenderSettings(PerPixel(), 1, FACE_PX, 1)
    plan = plan_from_settings(settings, make_camera(), kind=RendererKind.RASTER, reason="measured")
    view = renderer.prepare(make_camera(), plan)
    times = measure_ms(lambda: view.render(CAMERA_STATE), lambda: None)
    view.close()
    renderer.close()
    return times


def make_atlas(size: int) -> Atlas:
    parts = face_regions(make_camera(), make_camera().rim_rad, size_px=size, texels_per_px=1.0)
    return pack_atlas(parts, guard_texels=GUARD_TEXELS, max_texels=16384)


def main() -> None:
    for title, world in make_worlds().items():
        scene = build_scene(world)
        print(f"{title}, {len(scene)} triangles\n  {'':<36}{'median':>8}{'min':>8}")
        device = open_device()
        measure_storage(
            device.context,
            SceneBuffers(device.context, ShaderPrograms(device.context), scene, world),
        )
        device.close()
        chunk_sizes(world)
        measure_waiting(world)


if __name__ == "__main__":
    main()
