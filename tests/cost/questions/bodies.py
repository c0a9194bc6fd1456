"""What do moving robots cost a frame, and should their triangles be committed anew or rays turned?

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/cost/questions/bodies.py

Prints the median and the least milliseconds of a frame on the field with 0, 1, 4 and 16 robots in
sight, in both renderers: 640 x 640 px of the mirror and 320 x 240 px of an ordinary camera, 2 x 2
samples; then what preparing the ordinary camera anew costs, as a zoom does. Last, for 100 000 rays
around the viewpoint on one thread, the two ways that trace could ask for bodies. Decided by it:
render/trace/moving_bodies.py turns rays into each body's frame.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from scenes import EXPOSURE, camera, worlds

from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.optics.lenses import PerspectiveCamera
from catoptra_server.plan.render_plan import RendererKind, RenderWish, plan_from_wish
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.renderer import Exposure, Renderer, View
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.moving_bodies import BodyScenes, body_hits
from catoptra_server.render.trace.packed_light import LightScale
from catoptra_server.scene.bodies import Body
from catoptra_server.scene.meshes import build_scene
from catoptra_server.scene.robot_shapes import OmniTower, RobotShape, robot_mesh

FRAMES = 25
COUNTS = (0, 1, 4, 16)
P2AT = RobotShape((0.5238, 0.4968, 0.2913), 0.1457, 0.13, 0.2884)
ROBOT = robot_mesh(P2AT, OmniTower(camera(), Pose.from_rpy((0.0, 0.0, -0.4543))))
PERSPECTIVE = PerspectiveCamera(320, 240, math.radians(80.0))


def robots(count: int) -> tuple[Body, ...]:
    """Return robots in a ring around the viewpoint, from 0.9 m to 2.4 m away."""
    x, y, _ = EXPOSURE.world_from_mirror.translation
    bodies = []
    for index in range(count):
        bearing, distance = 2.4 * index, 0.9 + 0.1 * index  # golden angle: evenly all round
        place = (x + distance * math.cos(bearing), y + distance * math.sin(bearing), -0.1457)
        bodies.append(Body(ROBOT, Pose.from_rpy(place, (0.0, 0.0, 3.0 * bearing))))
    return tuple(bodies)


def milliseconds(act: Callable[[], object]) -> str:
    """Return the median and the least time, formatted."""
    times = []
    for _ in range(FRAMES):
        begin = time.perf_counter()
        act()
        times.append(1e3 * (time.perf_counter() - begin))
    return f"{statistics.median(times):8.2f}{min(times):8.2f}"


def report(name: str, view: View) -> None:
    for count in COUNTS:
        exposure = Exposure(EXPOSURE.world_from_mirror, robots(count))
        view.draw(exposure)
        print(
            f"  {name}, {count:2d} robots".ljust(38), milliseconds(lambda e=exposure: view.draw(e))
        )


def zoomed(renderer: Renderer) -> None:
    renderer.prepare_perspective(PERSPECTIVE, 2).close()


def frames() -> None:
    world = worlds()["field"]
    scene = build_scene(world)
    plan = plan_from_wish(RenderWish(samples=2), camera(), kind=RendererKind.RASTER, why="measured")
    for renderer in (TraceRenderer(scene, world), RasterRenderer(scene, world)):
        print(renderer.describe(), f"\n  {'':<36}  median     min")
        report("mirror", renderer.prepare(camera(), plan))
        report("perspective", renderer.prepare_perspective(PERSPECTIVE, 2))
        print(f"  {'perspective, prepared anew':<36}", milliseconds(lambda r=renderer: zoomed(r)))
        renderer.close()


def two_ways() -> None:
    """Print what it costs to commit all bodies again and ask all rays, and to turn the rays."""
    rng = np.random.default_rng(0)
    rays = rng.normal(size=(100_000, 3))
    rays[:, 2] = np.abs(rays[:, 2])
    rays = rays[np.argsort(np.arctan2(rays[:, 1], rays[:, 0]))]  # neighbours follow each other
    directions = (rays / np.linalg.norm(rays, axis=1, keepdims=True)).astype(np.float32)
    viewpoint = EXPOSURE.world_from_mirror.translation
    origins = np.broadcast_to(viewpoint.astype(np.float32), directions.shape)
    scale, scenes = LightScale.for_samples(4), BodyScenes(worlds()["field"].lights)
    print(f"100 000 rays on one thread, {len(ROBOT)} triangles a robot")
    for count in COUNTS[1:]:
        bodies = robots(count)

        def committed(bodies: tuple[Body, ...] = bodies) -> rtcore_scene.EmbreeScene:
            places = [body.world_from_body.points(body.mesh.corners) for body in bodies]
            scene = rtcore_scene.EmbreeScene()
            TriangleMesh(scene, np.concatenate(places).astype(np.float32))
            scene.run(origins[:1], directions[:1])
            return scene

        def turned(bodies: tuple[Body, ...] = bodies) -> None:
            body_hits(scenes.placed(bodies, viewpoint, scale), directions, scale)

        ready = committed()
        asked = milliseconds(lambda s=ready: s.run(origins, directions, output=True))
        print(f"  {count:2d} robots committed anew".ljust(38), milliseconds(committed))
        print(f"  {count:2d} robots, then asked".ljust(38), asked)
        print(f"  {count:2d} robots, rays turned".ljust(38), milliseconds(turned))


if __name__ == "__main__":
    frames()
    two_ways()
