"""Memory of views, effects, triangles and textures, by which `runtime/memory.py` estimates.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/memory_per_item.py

Prints, for each renderer, the peak of the resident size above that of a camera of 64 px: in MiB,
and in bytes for each sample, pixel, triangle or texel. Each case is a process of its own, since a
peak never falls. Decision: the constants of `runtime/memory.py` and `EffectSettings.bytes_per_px`.
The rays of trace are computed in batches since 512 px at 8 x 8 samples took 2096 MiB, six times as
much as now.
"""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from PIL import Image
from scenes import CAMERA_STATE, make_balls, make_camera, make_worlds

from catoptra_protocol.optics.perspective_camera import PerspectiveCamera
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.robot_file import read_robot
from catoptra_server.effects import ImageEffect, is_image_effect
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.frames.renderers import create_renderer
from catoptra_server.render.renderer import PerPixel, Renderer, RenderSettings, View
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.objects import CameraState, FogMedium, Shutter
from catoptra_server.world.scene_mesh import build_scene
from catoptra_server.world.world_description import Item, Material, Rectangle, Twist, World

# All effects that change the scene.
SCENE_STATE = replace(
    CAMERA_STATE,
    has_shadows=True,
    fog=FogMedium(0.1, (0.5, 0.5, 0.5)),
    twist=Twist((0.5, 0.0, 0.0), (0.0, 0.0, 1.0)),
    shutter=Shutter(0.02, 0.02, 8.0),
)

# Name, side of an image in pixels or number of balls of 2000 triangles, samples along a pixel.
CASES = (
    *(("view", 1024, samples) for samples in (1, 2)),
    *(("view", 2048, samples) for samples in (1, 2)),
    ("view", 512, 8),
    ("lens", 2048, 2),
    ("effects", 1024, 1),
    ("scene", 1024, 1),
    ("triangles", 100, 1),
    ("texture", 4096, 1),
)


def peak_mib() -> float:
    """Peak of this process's resident size so far."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    found = re.search(r"VmHWM:\s+(\d+) kB", status)
    assert found is not None, "/proc states no peak of this process"
    return int(found[1]) / 1024.0


def render(
    renderer: Renderer,
    kind: RendererKind,
    width_px: int,
    samples: int = 1,
    effects: tuple[ImageEffect, ...] = (),
    state: CameraState = CAMERA_STATE,
) -> None:
    """Prepare a camera's view and render one frame."""
    camera = make_camera(width_px)
    settings = RenderSettings(PerPixel(), samples)
    plan = plan_from_settings(settings, camera, kind=kind, reason="measured")
    view: View = renderer.prepare(camera, plan)
    view.render(state, effects)


def render_world(kind: RendererKind, world: World) -> None:
    """Build a world and render one small frame of it."""
    render(create_renderer(kind, build_scene(world), world), kind, 64)


def render_texture(kind: RendererKind, side_px: int) -> None:
    """Render a floor with a texture."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "texture.png"
        Image.new("RGB", (side_px, side_px)).save(path)
        floor = Item(
            "floor", Rectangle((20.0, 20.0)), Pose.identity(), Material((1, 1, 1), texture=path)
        )
        render_world(kind, World("texture", (floor,)))


def render_lens(renderer: Renderer, side_px: int, samples: int) -> None:
    """Prepare a perspective camera's view and render one frame."""
    camera = PerspectiveCamera(side_px, side_px, 1.5)
    renderer.prepare_perspective(camera, samples).render(CAMERA_STATE)


def bundled_effects() -> tuple[ImageEffect, ...]:
    """All image effects of the bundled robot that has most."""
    omni = read_robot(find_configuration("robots", "p2at_omni_real"))[0].omni_camera
    assert omni is not None
    effects = (setting.effect for setting in omni.effects.settings)
    return tuple(effect for effect in effects if is_image_effect(effect))


def measure(kind: RendererKind, name: str, size: int, samples: int) -> None:
    """Print the peak of one case above that of a small camera."""
    world = make_worlds()["field"]
    renderer = create_renderer(kind, build_scene(world), world)
    # Libraries, threads and programs are part of any server.
    render(renderer, kind, 64)
    num_pixels = size * size
    effects = bundled_effects()
    cases: dict[str, tuple[int, Callable[[], None]]] = {
        "view": (num_pixels * samples**2, lambda: render(renderer, kind, size, samples)),
        "lens": (num_pixels * samples**2, lambda: render_lens(renderer, size, samples)),
        "scene": (num_pixels, lambda: render(renderer, kind, size, samples, state=SCENE_STATE)),
        "effects": (num_pixels, lambda: render(renderer, kind, size, samples, effects)),
        "triangles": (2000 * size, lambda: render_world(kind, make_balls(size))),
        "texture": (num_pixels, lambda: render_texture(kind, size)),
    }
    num_items, run = cases[name]
    before = peak_mib()
    run()
    taken = peak_mib() - before
    print(
        f"{kind.value:8}{name:10}{size:6}{samples:4}{taken:10.0f}{taken * 2**20 / num_items:10.1f}"
    )


def main() -> None:
    if len(sys.argv) == 5:
        kind, name, size, samples = sys.argv[1:]
        measure(RendererKind(kind), name, int(size), int(samples))
        return
    print(f"{'':8}{'':10}{'size':>6}{'n':>4}{'MiB':>10}{'bytes':>10}", flush=True)
    for kind in RendererKind:
        for name, size, samples in CASES:
            arguments = (kind.value, name, str(size), str(samples))
            subprocess.run([sys.executable, __file__, *arguments], check=True)


if __name__ == "__main__":
    main()
