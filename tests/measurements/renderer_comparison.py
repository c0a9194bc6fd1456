"""Frame times of the renderers on this machine, and the rates of the rule that chooses one.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/renderer_comparison.py

Scenes with few, many and a million triangles, with textures, with point lights; 360, 640 and 1024
px; 1 to 4 samples along a pixel's side. For each the median time of a frame with read-back by the
kernel, by the reference where that is bearable, and by raster, rendered in turns: half the
processor time of all threads. On two cores that is the wall time of a frame that keeps both at
work, and it is comparable on a machine with other load. Then the rates fitted to these times, and
how often the rule picks the faster renderer. Decision: the rates of planning/renderer_rule.py.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from interleaved import median_ms
from scenes import CAMERA_STATE, CORRIDOR, FIELD, make_balls, make_camera

from catoptra_server.config.world_file import read_world
from catoptra_server.planning.cost_model import fit_nonnegative_rates
from catoptra_server.planning.effect_rates import RenderEngine
from catoptra_server.planning.explicit_plan import plan_from_settings
from catoptra_server.planning.renderer_rule import (
    ImageLoad,
    SceneLoad,
    rule_features,
)
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.renderer import Renderer
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.robot.render_settings import PerPixel, RenderSettings
from catoptra_server.scene.scene_mesh import SceneMesh, build_scene
from catoptra_server.scene.world_description import PointLight, World

IMAGES = ((360, 1), (360, 2), (640, 1), (640, 2), (640, 3), (640, 4), (1024, 1), (1024, 2))
# A frame of the reference takes up to a second a sample of each pixel.
REFERENCE_IMAGES = ((360, 1), (360, 2), (640, 1))
LAMPS = tuple(PointLight((x, 0.5, -2.0), (1.0, 0.9, 0.8)) for x in (-1.0, 1.0))


@dataclass(frozen=True, slots=True)
class MeasuredFrame:
    """A frame of one engine, with what its time grows with."""

    title: str
    engine: RenderEngine
    scene: SceneLoad
    image: ImageLoad
    frame_ms: float


def make_worlds() -> Iterator[tuple[str, World]]:
    field, corridor = read_world(FIELD)[0], read_world(CORRIDOR)[0]
    yield "field", field
    yield "corridor", corridor
    yield "balls", make_balls()
    yield "field, 2 lamps", replace(field, lights=(*field.lights, *LAMPS))
    yield "corridor, 2 lamps", replace(corridor, lights=(*corridor.lights, *LAMPS))
    yield "million", make_balls(500)


def make_renderers(mesh: SceneMesh, world: World) -> dict[RenderEngine, Renderer]:
    return {
        RenderEngine.KERNEL: TraceRenderer(mesh, world, engine="kernel"),
        RenderEngine.REFERENCE: TraceRenderer(mesh, world, engine="reference"),
        RenderEngine.SOFTWARE_OPENGL: RasterRenderer(mesh, world),
    }


def measure_image(
    title: str, world: World, mesh: SceneMesh, side_px: int, samples: int, rounds: int
) -> Iterator[MeasuredFrame]:
    """Measure one image by all engines, in turns."""
    camera, settings = make_camera(side_px), RenderSettings(PerPixel(), samples)
    scene, image = SceneLoad.from_scene(mesh, world.lights), ImageLoad(side_px**2, samples)
    renderers, draws = make_renderers(mesh, world), {}
    for engine, renderer in renderers.items():
        is_reference = engine is RenderEngine.REFERENCE
        if is_reference and ((side_px, samples) not in REFERENCE_IMAGES or len(mesh) > 100_000):
            continue
        is_raster = engine is RenderEngine.SOFTWARE_OPENGL
        kind = RendererKind.RASTER if is_raster else RendererKind.TRACE
        view = renderer.prepare(
            camera, plan_from_settings(settings, camera, kind=kind, reason="measured")
        )
        draws[engine.value] = partial(view.render, CAMERA_STATE)
    for name, (_, processor_ms) in median_ms(draws, rounds=rounds).items():
        yield MeasuredFrame(title, RenderEngine(name), scene, image, 0.5 * processor_ms)
    for renderer in renderers.values():
        renderer.close()


def print_rates(frames: list[MeasuredFrame]) -> dict[RenderEngine, tuple[float, ...]]:
    """Print the fitted rates of each engine and how far they are off; the rates."""
    rates = {}
    for engine in RenderEngine:
        mine = [frame for frame in frames if frame.engine is engine]
        features = np.array([rule_features(engine, one.scene, one.image) for one in mine])
        measured = np.array([one.frame_ms for one in mine])
        rates[engine] = fit_nonnegative_rates(features, measured)
        quotient = features @ rates[engine] / measured
        numbers = ", ".join(f"{rate:.3g}" for rate in rates[engine])
        print(f"{engine}: ({numbers}), {quotient.min():.2f} to {quotient.max():.2f} of measured")
    return rates


def print_choices(
    frames: list[MeasuredFrame], rates: dict[RenderEngine, tuple[float, ...]]
) -> None:
    """Print how often the rule picks the faster of kernel and raster, and what it loses."""
    pair = (RenderEngine.KERNEL, RenderEngine.SOFTWARE_OPENGL)
    cases: dict[tuple[str, ImageLoad], dict[RenderEngine, MeasuredFrame]] = {}
    for frame in frames:
        if frame.engine in pair:
            cases.setdefault((frame.title, frame.image), {})[frame.engine] = frame
    losses = []
    for (title, image), by_engine in cases.items():
        predicted = {
            engine: float(np.dot(rates[engine], rule_features(engine, one.scene, one.image)))
            for engine, one in by_engine.items()
        }
        chosen = by_engine[min(predicted, key=lambda engine: predicted[engine])]
        best_ms = min(one.frame_ms for one in by_engine.values())
        losses.append(chosen.frame_ms / best_ms)
        if losses[-1] > 1.0:
            print(f"  {title}, {image}: {chosen.engine.value} takes {losses[-1]:.2f} of the best")
    right = sum(loss == 1.0 for loss in losses)
    print(f"the rule picks the faster of both in {right} of {len(losses)} cases")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=7)
    rounds, frames = parser.parse_args().rounds, list[MeasuredFrame]()
    for title, world in make_worlds():
        mesh = build_scene(world)
        print(f"{title}, {len(mesh)} triangles")
        for side_px, samples in IMAGES:
            row = list(measure_image(title, world, mesh, side_px, samples, rounds))
            times = ", ".join(f"{one.engine.value} {one.frame_ms:.1f}" for one in row)
            print(f"  {side_px:5} px {samples} x {samples}: {times}", flush=True)
            frames += row
    print_choices(frames, print_rates(frames))


if __name__ == "__main__":
    main()
