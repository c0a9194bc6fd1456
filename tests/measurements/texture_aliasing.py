"""How far a textured floor is from its mean over each pixel, by the limit of stretched footprints.

Run: .venv/bin/python tests/measurements/texture_aliasing.py

A checkerboard, a bundled texture and noise on a floor, seen from 0.6 m above it by the paper's
camera at 200 px; the rms difference, in grey levels, between images of 1 or 2 samples along a
pixel's side and one of 16, for values of world/textures.MAX_STRETCH (0: the image itself,
without levels). The reference engine renders, which reads the constant at each frame. Decision:
MAX_STRETCH.
"""

from __future__ import annotations

import tempfile
from functools import partial
from pathlib import Path

import numpy as np
from PIL import Image
from scenes import FIELD, make_camera

from catoptra_protocol.optics.omni_camera import direction_from_pixel_grid
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.render.trace.kernel.kernel_engine import KernelEngine
from catoptra_server.render.trace.ray_table import build_ray_table
from catoptra_server.render.trace.reference.reference_engine import ReferenceEngine
from catoptra_server.world import textures as texture_levels
from catoptra_server.world.objects import CameraState
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import (
    HemisphereLight,
    Item,
    Material,
    Rectangle,
    World,
)

STRETCHES = (0.0, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 1e9)
STATE = CameraState(Pose.from_rpy((0.31, 0.17, -0.6), (0.02, -0.03, 0.3)))
LIGHT = HemisphereLight((1.0, 1.0, 1.0), (1.0, 1.0, 1.0))


def write_images(folder: Path) -> dict[str, Path]:
    """Files of 256 x 256 px."""
    rows, columns = np.mgrid[:256, :256]
    noise = np.random.default_rng(1).integers(0, 256, (256, 256))
    images = {
        "checkers of 3 cm": 255 * ((rows // 16 + columns // 16) % 2),
        "checkers of 4 mm": 255 * ((rows // 2 + columns // 2) % 2),
        "noise of 2 mm": noise,
    }
    paths = {"tiles": FIELD.parent / "textures/tiles.png"}
    for name, grey in images.items():
        paths[name] = folder / f"{name}.png"
        Image.fromarray(np.repeat(grey[..., None], 3, axis=-1).astype(np.uint8)).save(paths[name])
    return paths


def main() -> None:
    """Print a table for each texture."""
    camera = make_camera(200)
    tables = {
        samples: build_ray_table(camera, samples, partial(direction_from_pixel_grid, camera))
        for samples in (1, 2, 16)
    }
    with tempfile.TemporaryDirectory() as folder:
        for name, path in write_images(Path(folder)).items():
            repeat = (20.0, 20.0) if name == "tiles" else (40.0, 40.0)
            floor = Item(
                "floor", Rectangle((20, 20), repeat), Pose.identity(), Material((1.0,) * 3, path)
            )
            world = World("floor", (floor,), lights=(LIGHT,), background=(0.3, 0.3, 0.35))
            mesh = build_scene(world)
            truth = KernelEngine(mesh, world, threads=2, scene_lights=world.lights)
            expected = truth.prepare(tables[16]).render_srgb(STATE).astype(float)
            engine = ReferenceEngine(mesh, world, threads=2, scene_lights=world.lights)
            for samples in (1, 2):
                rays, row = engine.prepare(tables[samples]), []
                for stretch in STRETCHES:
                    texture_levels.MAX_STRETCH = stretch
                    image = rays.render_srgb(STATE).astype(float)
                    row.append(f"{np.sqrt(np.square(image - expected).mean()):.2f}")
                print(f"{name}, {samples} x {samples}: {'  '.join(row)}")
            engine.close()
            truth.close()


if __name__ == "__main__":
    print("stretch:", STRETCHES)
    main()
