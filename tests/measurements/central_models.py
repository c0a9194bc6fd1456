"""What a frame of each central camera model costs, against the hyperbolic mirror.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/central_models.py

Prints median processor milliseconds of one thread for 640 x 640 px of every shipped lens and of the
parabolic mirror, each beside a hyperbolic mirror of the same rim, in turns; and of the rays alone,
without proofs, hits and light. Models differ in where their pixels look, and so in what these meet;
the mirror's own radii as a table show what the model itself costs. Decision: none of the kernel's
code knows the model, ARCHITECTURE's entry "A camera is a radial projection and an image plane".
"""

from __future__ import annotations

import argparse
import math
from functools import partial

import numpy as np
from interleaved import median_ms
from scenes import CAMERA_STATE, FIELD

from catoptra_protocol.optics.lenses import (
    DoubleSphereLens,
    EnhancedUnifiedLens,
    EquidistantLens,
    EquisolidLens,
    FThetaLens,
    KannalaBrandtLens,
    OCamLens,
    RadialTableLens,
    StereographicLens,
    UnifiedLens,
    WoodScapeLens,
)
from catoptra_protocol.optics.mirrors import PAPER_MIRROR, ParabolicMirror
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.radial_camera import RadialProjection
from catoptra_server.config.world_file import read_world
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.render_settings import RenderSettings
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace.kernel.kernel_engine import KernelEngine, KernelRays
from catoptra_server.render.trace.ray_table import omni_ray_table
from catoptra_server.world.scene_mesh import build_scene

RIM_RAD = math.radians(100.0)
# All with the image of the hyperbolic mirror: its radii at 33 angles.
ANGLES = tuple(RIM_RAD * step / 32 for step in range(33))


def measured_mirror() -> RadialTableLens:
    """The hyperbolic mirror's own radii as a table: another model of the same rays."""
    t = np.tan(0.5 * np.array(ANGLES))
    radii = PAPER_MIRROR.radius_ratio_from_t(t).tolist()
    return RadialTableLens(tuple(map(math.degrees, ANGLES)), tuple(100.0 * r for r in radii))


MODELS: dict[str, RadialProjection] = {
    "hyperbolic mirror again": PAPER_MIRROR,
    "the same as a table": measured_mirror(),
    "parabolic mirror": ParabolicMirror(0.03),
    "equidistant": EquidistantLens(),
    "equisolid": EquisolidLens(),
    "stereographic": StereographicLens(),
    "Kannala-Brandt": KannalaBrandtLens(0.003, 0.0007, -0.002, 0.0002),
    "unified (Mei)": UnifiedLens(1.2, -0.05, 0.002),
    "EUCM": EnhancedUnifiedLens(0.6, 1.1),
    "double sphere": DoubleSphereLens(-0.17, 0.59),
    "OCam": OCamLens((200.0, 0.0, -2e-3, 4e-6, -2e-8)),
    "WoodScape": WoodScapeLens(340.0, -32.0, 48.0, -7.2),
    "f-theta": FThetaLens(0.003, 1e-7),
}


def prepare_rays(engine: KernelEngine, projection: RadialProjection) -> KernelRays:
    camera: OmniCamera = camera_with_inscribed_rim(
        projection, width_px=640, height_px=640, rim_rad=RIM_RAD
    )
    plan = plan_from_settings(
        RenderSettings(samples=2), camera, kind=RendererKind.TRACE, reason="measured"
    )
    return engine.prepare(omni_ray_table(camera, plan))


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--rounds", type=int, default=21)
    rounds = parser.parse_args().rounds
    world = read_world(FIELD)[0]
    engine = KernelEngine(build_scene(world), world, threads=1, scene_lights=world.lights)
    print(f"field, {engine.description}, rim at {math.degrees(RIM_RAD):g} degrees")
    reference = prepare_rays(engine, PAPER_MIRROR)
    for name, projection in MODELS.items():
        rays = prepare_rays(engine, projection)
        draws = {
            "model": partial(rays.render_srgb, CAMERA_STATE),
            "hyperbolic": partial(reference.render_srgb, CAMERA_STATE),
        }
        times = {title: row[1] for title, row in median_ms(draws, rounds=rounds).items()}
        bare = {
            "model": partial(rays.trace_bare, CAMERA_STATE),
            "hyperbolic": partial(reference.trace_bare, CAMERA_STATE),
        }
        traced = {title: row[1] for title, row in median_ms(bare, rounds=rounds).items()}
        print(
            f"  {name:24} x {times['model'] / times['hyperbolic']:.2f} a frame "
            f"({times['model']:.1f} ms), x {traced['model'] / traced['hyperbolic']:.2f} bare rays"
        )
        rays.close()
    engine.close()


if __name__ == "__main__":
    main()
