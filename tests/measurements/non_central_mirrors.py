"""What a frame of a mirror without a viewpoint costs, against the same mirror's approximation.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/non_central_mirrors.py

Prints median processor milliseconds of one thread for 640 x 640 px of each shipped mirror, exact
and with one viewpoint (`Central=always`), in turns, and the shares of their tiles that are filled
without a ray. Decision: what beams of rays without a viewpoint are worth, ARCHITECTURE's entry
"A mirror without a viewpoint has a ray for each sample".
"""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from functools import partial

from interleaved import median_ms
from scenes import CAMERA_STATE, CORRIDOR, FIELD, make_balls

from catoptra_protocol.optics.mirrors import (
    ConicalMirror,
    EquiangularMirror,
    ProfileMirror,
    SphericalMirror,
)
from catoptra_protocol.optics.mirrors.non_central import NonCentralMirror
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_server.config.world_file import read_world
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.render_settings import RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace.kernel.kernel_engine import KernelEngine, KernelRays
from catoptra_server.render.trace.ray_table import omni_ray_table
from catoptra_server.world.camera_state import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import World

SAG_R = (0.0, 0.01, 0.02, 0.03, 0.05)
MIRRORS: dict[str, NonCentralMirror] = {
    "spherical": SphericalMirror(0.03, 0.2, math.radians(120.0)),
    "conical": ConicalMirror(math.radians(60.0), 0.1, math.radians(100.0)),
    "equiangular": EquiangularMirror(11.0, 0.1, math.radians(120.0)),
    "profile": ProfileMirror(SAG_R, tuple(8.0 * r * r for r in SAG_R), 0.2, math.radians(70.0)),
}


def make_worlds() -> dict[str, World]:
    return {
        "field": read_world(FIELD)[0],
        "corridor": read_world(CORRIDOR)[0],
        "balls": make_balls(),
    }


def prepare_rays(engine: KernelEngine, camera: OmniCamera, samples: int) -> KernelRays:
    plan = plan_from_settings(
        RenderSettings(samples=samples), camera, kind=RendererKind.TRACE, reason="measured"
    )
    return engine.prepare(omni_ray_table(camera, plan))


def print_row(
    engine: KernelEngine, name: str, *, samples: int, state: CameraState, rounds: int
) -> None:
    mirror = MIRRORS[name]
    camera = camera_with_inscribed_rim(mirror, width_px=640, height_px=640, rim_rad=mirror.rim_rad)
    exact = prepare_rays(engine, camera, samples)
    central = prepare_rays(engine, replace(camera, is_approximated=True), samples)
    draws = {"exact": partial(exact.render_srgb, state), "one": partial(central.render_srgb, state)}
    times = {title: row[1] for title, row in median_ms(draws, rounds=rounds).items()}
    shares = [
        rays.last_counts.num_filled_tiles / rays.last_counts.num_tiles for rays in (exact, central)
    ]
    print(
        f"  {name:12} {times['exact']:6.1f} ms, {times['one']:6.1f} ms with one viewpoint, "
        f"x {times['exact'] / times['one']:.2f}; filled {shares[0]:5.1%}, {shares[1]:5.1%}"
    )
    exact.close()
    central.close()


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=21)
    parser.add_argument("--samples", type=int, default=2)
    parser.add_argument("worlds", nargs="*", default=["field", "corridor"])
    arguments = parser.parse_args()
    for title in arguments.worlds:
        world = make_worlds()[title]
        engine = KernelEngine(build_scene(world), world, threads=1, scene_lights=world.lights)
        for has_shadows in (False, True):
            state = replace(CAMERA_STATE, has_shadows=has_shadows)
            print(f"{title}, {engine.description}{', shadows' if has_shadows else ''}")
            for name in MIRRORS:
                print_row(
                    engine, name, samples=arguments.samples, state=state, rounds=arguments.rounds
                )
        engine.close()


if __name__ == "__main__":
    main()
