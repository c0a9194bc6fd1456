"""Pages of the image effects, one an effect: the image without, with, and the difference.

Each page shows a scene that needs the effect. Below stand the decisions of the effect's criterion
there and in a scene where the effect is negligible.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from catoptra_protocol.optics.mirrors import PAPER_MIRROR
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.startup import read_startup_config
from catoptra_server.effects import (
    Effect,
    EffectMode,
    EffectSetting,
    EffectSettings,
    SceneSummary,
)
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.effect_plan import EffectDecision, apply_scene_effects, plan_effects
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.frames.renderers import create_renderer
from catoptra_server.render.renderer import RenderSettings, View
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.simulation.robot_bodies import build_ego_mesh
from catoptra_server.simulation.robot_description import RobotDescription
from catoptra_server.world.objects import CameraState, DynamicObject, NoiseSeed, build_object_mesh
from catoptra_server.world.shapes import box
from catoptra_server.world.world_description import Box, Material, srgb_from_linear
from catoptra_studies.effects.effect_cases import EFFECT_CASES, EffectCase
from catoptra_studies.plot_style import MUTED, TEAL, Page, add_text, open_page, show_image

_IMAGE_SIZE_PX = 480
_PANEL_PX = 480
# Any seed: the pages show the strength of noise, not the values.
_NOISE_SEED = NoiseSeed((1, 2), 3)
# Upper left corner of the enlarged detail: the yellow goal and the line in front.
_DETAIL_CORNER = (120, 264)


def write_effect_pages(folder: Path, *, on_page: Callable[[], None] = lambda: None) -> None:
    """Write a page for each case, and explanations.txt with the decisions.

    Args:
        folder: Folder for the pages, made where missing.
        on_page: Called after each page.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lines = []
    with _open_scene() as scene:
        for case in EFFECT_CASES:
            required, negligible = _decide_both(case, scene)
            captions = (
                f"{case.description}: {_describe_decision(required)}",
                f"{case.negligible_case.description}: {_describe_decision(negligible)}",
            )
            path = folder / f"{case.effect.name}.png"
            with open_page(path, 660) as page:
                _draw_page(page, case, scene, captions)
            lines += [*captions, ""]
            on_page()
    (folder / "explanations.txt").write_text("\n".join(lines), encoding="utf-8")


@dataclass(frozen=True, slots=True, eq=False)
class _EffectScene:
    """The paper's field with a robot near the centre, ready to be rendered."""

    summarizer: SceneSummarizer
    view: View
    robot: RobotDescription

    def camera_state(self, case: EffectCase) -> CameraState:
        """State of the robot's camera in the motion of the case."""
        omni, ego_mesh = self.robot.omni_camera, build_ego_mesh(self.robot)
        assert omni is not None, "p2at_omni_real has a mirror camera"
        assert ego_mesh is not None, "p2at_omni_real describes its own body"
        height_m = self.robot.drive.ride_height_m
        world_from_robot = Pose.from_rpy((0.5, 0.3, -height_m), (0.0, 0.0, 0.3))
        world_from_mirror = world_from_robot @ omni.robot_from_mirror
        twist = case.twist.rotate(world_from_robot.rotation)
        # The mirror is off the robot's axis, so a turning robot also moves the camera sideways.
        lever_m = world_from_mirror.translation - world_from_robot.translation
        return CameraState(
            world_from_mirror,
            _near_objects(world_from_mirror, case.board_distance_m),
            _NOISE_SEED,
            twist=twist.at_offset(lever_m),
            ego_body=DynamicObject(ego_mesh, world_from_robot, twist),
        )

    def render_linear(self, case: EffectCase, effects: Sequence[Effect]) -> Floats:
        """(h, w, 3) linear image behind the given effects, all on."""
        settings = EffectSettings(
            tuple(EffectSetting(effect, EffectMode.ALWAYS) for effect in effects)
        )
        plan = plan_effects(settings, self.summarize(case), _paper_camera(120.0))
        state = apply_scene_effects(self.camera_state(case), plan)
        return self.view.render_linear(state, plan.image_effects).astype(np.float64)

    def summarize(self, case: EffectCase) -> SceneSummary:
        """Bounds of the scene that the criteria read."""
        return self.summarizer.summarize(self.camera_state(case), _paper_camera(120.0))


def _near_objects(world_from_mirror: Pose, distance_m: float) -> tuple[DynamicObject, ...]:
    """A striped board ahead of the viewpoint; none at infinite distance."""
    if math.isinf(distance_m):
        return ()
    greys = (0.9, 0.05) * 3
    # Unlit, so that the stripes keep their contrast wherever the light comes from.
    materials = (Material((grey,) * 3, unlit=True) for grey in greys)
    stripes = (
        box(Box((0.002, 0.15, 0.01))).translate((0.0, 0.0, 0.01 * row - 0.025))
        for row in range(len(greys))
    )
    board = build_object_mesh(zip(stripes, materials, strict=True))
    return (DynamicObject(board, world_from_mirror @ Pose.from_rpy((distance_m, 0.0, 0.0))),)


@contextmanager
def _open_scene() -> Iterator[_EffectScene]:
    """Prepare the field for the trace renderer, 3 x 3 samples a pixel."""
    config = read_startup_config(
        [find_configuration("robots", "p2at_omni_real")],
        find_configuration("worlds", "four_legged_2006"),
    )
    # Level surfaces are polished, which only the page of gloss shows.
    is_level = config.scene.normals[:, 2:] < -0.99
    scene = replace(config.scene, gloss=np.where(is_level, (0.05, 0.1), 0.0))
    renderer = create_renderer(RendererKind.TRACE, scene, config.world)
    camera = _paper_camera(120.0)
    # More than a frame by default, since aliased edges would hide small differences.
    settings = RenderSettings(samples=3)
    plan = plan_from_settings(settings, camera, kind=RendererKind.TRACE, reason="effect page")
    summarizer = SceneSummarizer(scene, config.world)
    yield _EffectScene(summarizer, renderer.prepare(camera, plan), config.robots[0])
    renderer.close()


def _paper_camera(rim_deg: float) -> OmniCamera:
    return camera_with_inscribed_rim(
        PAPER_MIRROR,
        width_px=_IMAGE_SIZE_PX,
        height_px=_IMAGE_SIZE_PX,
        rim_rad=float(np.radians(rim_deg)),
    )


def _decide_both(case: EffectCase, scene: _EffectScene) -> tuple[EffectDecision, EffectDecision]:
    """Decisions of the criterion in the scene shown and in the negligible one."""
    effects = (*case.upstream_effects, case.effect)
    settings = EffectSettings(tuple(EffectSetting(effect, EffectMode.AUTO) for effect in effects))
    # Upstream effects take part: exposure and lens change the radiance that a criterion bounds.
    required = plan_effects(settings, scene.summarize(case), _paper_camera(120.0))
    # No scene is built: a summary with bounds of an empty, still scene is enough.
    negligible_case = case.negligible_case
    effects = (negligible_case.effect, *negligible_case.downstream_effects)
    negligible = plan_effects(
        EffectSettings(tuple(EffectSetting(effect, EffectMode.AUTO) for effect in effects)),
        SceneSummary(negligible_case.max_radiance),
        _paper_camera(negligible_case.rim_deg),
    )
    return required.decisions[-1], negligible.decisions[0]


def _draw_page(
    page: Page, case: EffectCase, scene: _EffectScene, captions: tuple[str, str]
) -> None:
    without = srgb_from_linear(scene.render_linear(case, case.upstream_effects))
    with_effect = srgb_from_linear(scene.render_linear(case, (*case.upstream_effects, case.effect)))
    difference = with_effect - without
    gain = _display_gain(_crop_detail(difference, case.zoom))
    # Around grey, so that both signs of the difference show.
    images = (without, with_effect, 0.5 + gain * difference)
    titles = ("without", f"with {case.effect.name}", f"difference, grey = none, times {gain}")
    for index, (image, title) in enumerate(zip(images, titles, strict=True)):
        left = 20 + index * (_PANEL_PX + 20)
        add_text(page, left, 18, title, fontweight="bold")
        detail = 255.0 * np.clip(_crop_detail(image, case.zoom), 0.0, 1.0)
        show_image(page, np.rint(detail).astype(np.uint8), left, 56, _PANEL_PX)
    add_text(page, 20, 560, captions[0], color=TEAL)
    add_text(page, 20, 604, captions[1], color=MUTED)


def _describe_decision(decision: EffectDecision) -> str:
    state, sign = ("on", ">") if decision.enabled else ("off", "≤")
    numbers = f"{decision.bound:.3g} {sign} {decision.threshold:g} grey levels"
    return f"{state}, {numbers} ({decision.reason})"


def _crop_detail(values: Floats, zoom: int) -> Floats:
    """The whole image, or the detail that fills the panel at a zoom above 1."""
    if zoom == 1:
        return values
    size_px = _IMAGE_SIZE_PX // zoom
    row, column = _DETAIL_CORNER
    return values[row : row + size_px, column : column + size_px]


def _display_gain(difference: Floats) -> int:
    """Largest power of two by which a difference can be multiplied without much clipping."""
    # One pixel in a thousand may clip: else a single highlight would keep the rest invisible.
    maximum = float(np.quantile(np.abs(difference), 0.999))
    return int(2 ** np.floor(np.log2(0.5 / max(maximum, 1e-4)))) if maximum < 0.5 else 1
