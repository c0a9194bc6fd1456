"""The command `python -m catoptra_studies.effects.effect_pages`: what each effect does, and when not.

A page an effect: the picture without it, with it, and their difference, in a scene that calls for
it; below, the criterion's words there and in a scene that does not. The pictures are traced.
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

# NumPy's BLAS threads would spin beside the renderer's; set before NumPy is loaded below.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera, camera_with_inscribed_rim
from catoptra_protocol.optics.transforms import Pose
from catoptra_server.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.capture.camera_state import CameraState
from catoptra_server.capture.noise_seed import NoiseSeed
from catoptra_server.config.bundled_files import find_configuration
from catoptra_server.effects.effect import Effect, EffectMode, EffectSetting, EffectSettings
from catoptra_server.effects.effect_plan import EffectDecision, apply_scene_effects, plan_effects
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.planning.explicit_plan import plan_from_settings
from catoptra_server.planning.renderer_choice import create_renderer
from catoptra_server.render.renderer import Image, OmniView
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.render_settings import RenderSettings
from catoptra_server.robot.robot_description import RobotDescription
from catoptra_server.scene.colour import srgb_from_linear
from catoptra_server.scene.dynamic_object import DynamicObject, build_object_mesh
from catoptra_server.scene.primitives import box
from catoptra_server.scene.world_description import Box, Material
from catoptra_server.simulation.robot_meshes import build_ego_mesh
from catoptra_server.startup import read_startup_config
from catoptra_studies import plot_style
from catoptra_studies.effects.effect_cases import EFFECT_CASES, EffectCase

_IMAGE_SIZE_PX = 480
_PANEL_PX = 480
_NOISE_SEED = NoiseSeed((1, 2), 3)


def write_effect_pages(folder: Path) -> None:
    """Write a page a case, and the explanations as text, into a folder that is made if need be."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = []
    with _open_scene() as field:
        for case in EFFECT_CASES:
            here, there = _decide_both(case, field)
            with plot_style.open_page(plot_style.PAGE_WIDTH_PX, 660) as page:
                _draw_page(page, case, field, here, there)
                plot_style.save_page(page, folder / f"{case.effect.name}.png")
            lines += [
                f"{case.description}: {_describe_decision(here)}",
                f"{case.negligible_case.description}: {_describe_decision(there)}",
                "",
            ]
    (folder / "explanations.txt").write_text("\n".join(lines), encoding="utf-8")


@dataclass(frozen=True, slots=True, eq=False)
class EffectScene:
    """The field from near its middle, ready to be drawn, and the robot that stands there."""

    summarizer: SceneSummarizer
    view: OmniView
    robot: RobotDescription

    def camera_state(self, case: EffectCase) -> CameraState:
        """Return the exposure of the robot's camera while it moves as a case wants it."""
        omni, own = self.robot.omni_camera, build_ego_mesh(self.robot)
        assert omni is not None, "the figures' robot has a mirror"
        assert own is not None, "and its file names its own body"
        height = self.robot.drive.ride_height_m
        base = Pose.from_rpy((0.5, 0.3, -height), (0.0, 0.0, 0.3))
        mirror, in_world = base @ omni.robot_from_mirror, case.twist.rotate(base.rotation)
        return CameraState(
            mirror,
            _near_objects(mirror, case.board_distance_m),
            _NOISE_SEED,
            twist=in_world.at_offset(mirror.translation - base.translation),
            ego_body=DynamicObject(own, base, in_world),
        )

    def render_linear(self, case: EffectCase, effects: Sequence[Effect]) -> Floats:
        """Return the linear picture behind effects."""
        wishes = EffectSettings(
            tuple(EffectSetting(effect, EffectMode.ALWAYS) for effect in effects)
        )
        plan = plan_effects(wishes, self.scene_summary(case), _paper_camera(120.0))
        exposure = apply_scene_effects(self.camera_state(case), plan)
        return self.view.render_linear(exposure, plan.image_effects).astype(np.float64)

    def scene_summary(self, case: EffectCase) -> SceneSummary:
        """Return what criteria know of it."""
        return self.summarizer.summarize(self.camera_state(case), _paper_camera(120.0))


def _near_objects(world_from_mirror: Pose, distance_m: float) -> tuple[DynamicObject, ...]:
    """Return a striped board so far ahead of the viewpoint; none at inf."""
    if math.isinf(distance_m):
        return ()
    greys = (0.9, 0.05) * 3
    stripes = (Material((grey,) * 3, unlit=True) for grey in greys)
    boxes = (
        box(Box((0.002, 0.15, 0.01))).translate((0.0, 0.0, 0.01 * row - 0.025))
        for row in range(len(greys))
    )
    board = build_object_mesh(zip(boxes, stripes, strict=True))
    return (DynamicObject(board, world_from_mirror @ Pose.from_rpy((distance_m, 0.0, 0.0))),)


@contextmanager
def _open_scene() -> Iterator[EffectScene]:
    """Have the field traced."""
    setup = read_startup_config(
        [find_configuration("robots", "p2at_omni_real")],
        find_configuration("worlds", "four_legged_2006"),
    )
    renderer = create_renderer(RendererKind.TRACE, setup.scene, setup.world)
    camera = _paper_camera(120.0)
    plan = plan_from_settings(
        RenderSettings(samples=3), camera, kind=RendererKind.TRACE, reason="for a figure"
    )
    summarizer = SceneSummarizer(setup.scene, setup.world)
    yield EffectScene(summarizer, renderer.prepare(camera, plan), setup.robots[0])
    renderer.close()


def _paper_camera(rim_deg: float) -> OmniCamera:
    return camera_with_inscribed_rim(
        HyperbolicMirror(11.546, 0.2321),
        width_px=_IMAGE_SIZE_PX,
        height_px=_IMAGE_SIZE_PX,
        rim_rad=float(np.radians(rim_deg)),
    )


def _decide_both(case: EffectCase, scene: EffectScene) -> tuple[EffectDecision, EffectDecision]:
    wishes = tuple(
        EffectSetting(effect, EffectMode.AUTO) for effect in (*case.upstream_effects, case.effect)
    )
    summary = scene.scene_summary(case)
    here = plan_effects(EffectSettings(wishes), summary, _paper_camera(120.0)).decisions[-1]
    quiet = EffectSettings((EffectSetting(case.negligible_case.effect, EffectMode.AUTO),))
    there = plan_effects(
        quiet,
        SceneSummary(case.negligible_case.max_radiance),
        _paper_camera(case.negligible_case.rim_deg),
    )
    return here, there.decisions[-1]


def _draw_page(
    page: plot_style.Page,
    case: EffectCase,
    scene: EffectScene,
    required_decision: EffectDecision,
    negligible_decision: EffectDecision,
) -> None:
    without = srgb_from_linear(scene.render_linear(case, case.upstream_effects))
    with_it = srgb_from_linear(scene.render_linear(case, (*case.upstream_effects, case.effect)))
    difference = with_it - without
    gain = _display_gain(_crop_detail(difference, case.zoom))
    pictures = (without, with_it, 0.5 + gain * difference)
    titles = ("without", f"with {case.effect.name}", f"difference, grey = none, times {gain}")
    for index, (shown, title) in enumerate(zip(pictures, titles, strict=True)):
        left = 20 + index * (_PANEL_PX + 20)
        plot_style.add_text(page, left, 18, title, fontweight="bold")
        plot_style.show_image(
            page, _quantise_8_bit(_crop_detail(shown, case.zoom)), left, 56, _PANEL_PX
        )
    plot_style.add_text(
        page,
        20,
        560,
        f"{case.description}: {_describe_decision(required_decision)}",
        color=plot_style.TEAL,
    )
    plot_style.add_text(
        page,
        20,
        604,
        f"{case.negligible_case.description}: {_describe_decision(negligible_decision)}",
        color=plot_style.MUTED,
    )


def _describe_decision(decision: EffectDecision) -> str:
    state, sign = ("on", ">") if decision.enabled else ("off", "≤")
    numbers = f"{decision.bound:.3g} {sign} {decision.threshold:g} {decision.unit}"
    return f"{state}, {numbers} ({decision.reason})"


def _crop_detail(values: Floats, zoom: int) -> Floats:
    """Return the part of a picture that is shown: around a goal, where it is enlarged."""
    if zoom == 1:
        return values
    side = _IMAGE_SIZE_PX // zoom
    row, column = _DETAIL_CORNER
    return values[row : row + side, column : column + side]


# Top left corner of the enlarged part: the yellow goal and the line before it.
_DETAIL_CORNER = (120, 264)


def _display_gain(difference: Floats) -> int:
    """Return by what power of two a difference is shown: the most that is not clipped much."""
    largest = float(np.quantile(np.abs(difference), 0.999))
    return int(2 ** np.floor(np.log2(0.5 / max(largest, 1e-4)))) if largest < 0.5 else 1


def _quantise_8_bit(encoded: Floats) -> Image:
    greys: Image = np.rint(255.0 * np.clip(encoded, 0.0, 1.0)).astype(np.uint8)
    return greys


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw all pages; return 0."""
    parser = argparse.ArgumentParser(
        prog="python -m catoptra_studies.effects.effect_pages",
        description="Draw what each effect does where it is called for, and tell where it is not.",
    )
    parser.add_argument("--output", type=Path, required=True, metavar="DIR")
    parsed = parser.parse_args(arguments)
    write_effect_pages(parsed.output)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
