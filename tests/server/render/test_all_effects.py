"""A frame with every effect on: no seams where the faces of the cube meet, and counted resources.

Both renderers receive a camera state that needs all effects at once: a camera that drives and
turns, an object that crosses its path, shadows, fog, dust, noise. Trace has no faces; an image of
raster that equals trace's has no seam.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest

from catoptra_protocol.optics.cube_map import face_from_direction
from catoptra_protocol.optics.image_plane import pixel_sample_positions
from catoptra_protocol.optics.omni_camera import direction_from_pixel
from catoptra_server.effects import EFFECT_TYPES, ImageEffect
from catoptra_server.render.raster import RasterRenderer
from catoptra_server.render.raster.device import GlDevice
from catoptra_server.render.renderer import Image
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.world.objects import FogMedium, Shutter
from catoptra_server.world.scene_mesh import build_scene
from helpers.effect_measurement import DRIVING_STATE, make_effect
from helpers.image_comparison import level_differences, mask_away_from_edges
from helpers.opengl import make_raster
from helpers.worlds import make_omni_camera, make_plan, make_test_world

CAMERA = make_omni_camera(width_px=240)
PLAN = make_plan(CAMERA, samples=3)
# These change the scene, and have no pass.
SCENE_EFFECTS = ("SelfView", "Shadows", "BakedLight", "SkyRadiance", "Gloss", "Fog")
SCENE_EFFECTS += ("RollingShutter", "MotionBlur")
# Where the defaults do little: numbers that show.
STRONG: dict[str, dict[str, float]] = {
    "DefocusByDepth": {"f_number": 2.0, "pixel_pitch_m": 1.1e-5},
    "Misalignment": {"x_m": 3e-4, "y_m": -2e-4, "axial_m": 1e-3},
    "ChromaticAberration": {"red_magnification": 1.004, "blue_magnification": 0.997},
    "MirrorReflectance": {"refractive_index": 2.8, "extinction_coefficient": 3.4},
    "Exposure": {"exposure_s": 0.03},
    "WhiteBalance": {"red_gain": 1.3, "blue_gain": 0.8},
    "Response": {"knee": 0.3, "white": 2.0},
}
# The fixed part of the blur is in that by depth: never both.
NAMES = [name for name in EFFECT_TYPES if name not in (*SCENE_EFFECTS, "Defocus")]
CHAIN = tuple(make_effect(name, STRONG.get(name, {})) for name in NAMES)
CAMERA_STATE_WITH_ALL = replace(
    DRIVING_STATE,
    has_shadows=True,
    fog=FogMedium(0.1, (0.7, 0.5, 0.5)),
    shutter=Shutter(0.04, 0.03, 6),
)


def render_both(device: GlDevice, chain: tuple[ImageEffect, ...]) -> tuple[Image, Image]:
    """Traced and rastered image after a chain of effects."""
    world = make_test_world()
    scene = build_scene(world)
    trace = TraceRenderer(scene, world, threads=2)
    view = RasterRenderer(scene, world, device=device).prepare(CAMERA, PLAN)
    both = (
        trace.prepare(CAMERA, PLAN).render(CAMERA_STATE_WITH_ALL, chain).rgb,
        view.render(CAMERA_STATE_WITH_ALL, chain).rgb,
    )
    view.close()
    trace.close()
    return both


def find_seam_mask() -> npt.NDArray[np.bool_]:
    """(h, w) mask of the pixels next to another face, within two of the border."""
    directions, on_mirror = direction_from_pixel(CAMERA, pixel_sample_positions(CAMERA)[..., 0, :])
    face = face_from_direction(directions)
    near = np.zeros(face.shape, dtype=bool)
    for axis in (0, 1):
        for step in (-2, -1, 1, 2):
            near |= face != np.roll(face, step, axis)
    return near & on_mirror


def test_frame_when_every_effect_is_on_has_no_seams(device: GlDevice) -> None:
    difference = level_differences(*render_both(device, CHAIN))
    calm = mask_away_from_edges(render_both(device, ())[0])
    seam = find_seam_mask() & calm
    assert seam.sum() > 1000
    # A code of the converter more or less, rounded: one grey level.
    assert (difference[calm] > 1).mean() < 0.01
    assert (difference[seam] > 1).mean() < 0.01
    # A fifth of 1836 pixels differ by a level: three standard deviations of their mean.
    assert difference[seam].mean() <= difference[calm].mean() + 0.03
    # Outlines differ as they do without effects: each renderer shows them on its own samples.
    assert (difference > 4).mean() < 0.02


def test_frame_when_rendered_again_has_the_same_bytes(device: GlDevice) -> None:
    first, again = render_both(device, CHAIN), render_both(device, CHAIN)
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("name", NAMES)
def test_effect_when_it_runs_adds_passes_of_ranges_alone(device: GlDevice, name: str) -> None:
    renderer = make_raster(device)
    view = renderer.prepare(CAMERA, PLAN)
    view.render(DRIVING_STATE)
    view.render_linear(DRIVING_STATE)
    before = set(renderer.program_names)
    effect = make_effect(name, STRONG.get(name, {}))
    view.render(DRIVING_STATE, (effect,))
    ranges = ("ranges",) if effect.needs_range else ()
    assert view.pass_names == ("faces", "mirror", *ranges)
    added = {built.split()[0] for built in set(renderer.program_names) - before}
    assert added == ({"range", "pixel_range"} if ranges else set())
    view.close()
