"""The command `python -m catoptra_server.figures.effects`: what each effect does, and when not.

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

from catoptra_protocol.optics.camera import OmniCamera, camera_with_rim_inscribed
from catoptra_protocol.optics.frames import Pose
from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_protocol.optics.numerics import Floats
from catoptra_server.config.shipped import configuration_file
from catoptra_server.effects.decide import Decision, decide
from catoptra_server.effects.effect import Criterion, EffectWishes, Mode, Wish
from catoptra_server.effects.frame_key import FrameKey
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.figures import style
from catoptra_server.figures.effect_cases import CASES, Case
from catoptra_server.plan.render_plan import RendererKind, plan_from_wish
from catoptra_server.render.renderer import Exposure, Image
from catoptra_server.render.staging import staged
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.omni_view import TraceOmniView
from catoptra_server.robot.description import RobotDescription
from catoptra_server.robot.render_wish import RenderWish
from catoptra_server.scene.bodies import Body, body_mesh
from catoptra_server.scene.colour import srgb_from_linear
from catoptra_server.scene.description import Box, Material
from catoptra_server.scene.primitives import box
from catoptra_server.setup import read_setup
from catoptra_server.simulation.appearance import own_mesh

_SIDE_PX = 480
_PANEL_PX = 480
_KEY = FrameKey((1, 2), 3)


def write_pages(folder: Path) -> None:
    """Write a page a case, and the explanations as text, into a folder that is made if need be."""
    folder.mkdir(parents=True, exist_ok=True)
    lines = []
    with _field() as field:
        for case in CASES:
            here, there = _decisions(case, field)
            with style.page(style.PAGE_PX, 660) as page:
                _draw(page, case, field, here, there)
                style.save(page, folder / f"{case.effect.name}.png")
            lines += [f"{case.words}: {_told(here)}", f"{case.quiet.words}: {_told(there)}", ""]
    (folder / "explanations.txt").write_text("\n".join(lines), encoding="utf-8")


@dataclass(frozen=True, slots=True, eq=False)
class Field:
    """The field from near its middle, ready to be drawn, and the robot that stands there."""

    renderer: TraceRenderer
    view: TraceOmniView
    robot: RobotDescription

    def exposure(self, case: Case) -> Exposure:
        """Return the exposure of the robot's camera while it moves as a case wants it."""
        omni, own = self.robot.omni_camera, own_mesh(self.robot)
        assert omni is not None, "the figures' robot has a mirror"
        assert own is not None, "and its file names its own body"
        height = self.robot.drive.ride_height_m
        base = Pose.from_rpy((0.5, 0.3, -height), (0.0, 0.0, 0.3))
        mirror, in_world = base @ omni.robot_from_mirror, case.twist.turned(base.rotation)
        return Exposure(
            mirror,
            _things_near(mirror, case.near_m),
            _KEY,
            twist=in_world.at(mirror.translation - base.translation),
            own_body=Body(own, base, in_world),
        )

    def light(self, case: Case, effects: Sequence[Criterion]) -> Floats:
        """Return the linear picture behind effects."""
        wishes = EffectWishes(tuple(Wish(effect, Mode.ALWAYS) for effect in effects))
        plan = decide(wishes, self.summary(case), _camera(120.0))
        exposure = staged(self.exposure(case), plan)
        return self.view.draw_linear(exposure, plan.active).astype(np.float64)

    def summary(self, case: Case) -> SceneSummary:
        """Return what criteria know of it."""
        return self.renderer.summary(self.exposure(case), _camera(120.0))


def _things_near(mirror: Pose, near_m: float) -> tuple[Body, ...]:
    """Return a striped board so far ahead of the viewpoint; none at inf."""
    if math.isinf(near_m):
        return ()
    greys = (0.9, 0.05) * 3
    stripes = (Material((grey,) * 3, unlit=True) for grey in greys)
    boxes = (
        box(Box((0.002, 0.15, 0.01))).at((0.0, 0.0, 0.01 * row - 0.025))
        for row in range(len(greys))
    )
    board = body_mesh(zip(boxes, stripes, strict=True))
    return (Body(board, mirror @ Pose.from_rpy((near_m, 0.0, 0.0))),)


@contextmanager
def _field() -> Iterator[Field]:
    """Have the field traced."""
    setup = read_setup(
        [configuration_file("robots", "p2at_omni_real")],
        configuration_file("worlds", "four_legged_2006"),
    )
    renderer = TraceRenderer(setup.scene, setup.world)
    camera = _camera(120.0)
    plan = plan_from_wish(
        RenderWish(samples=3), camera, kind=RendererKind.TRACE, why="for a figure"
    )
    yield Field(renderer, renderer.prepare(camera, plan), setup.robots[0])
    renderer.close()


def _camera(rim_deg: float) -> OmniCamera:
    return camera_with_rim_inscribed(
        HyperbolicMirror(11.546, 0.2321),
        width_px=_SIDE_PX,
        height_px=_SIDE_PX,
        rim_rad=float(np.radians(rim_deg)),
    )


def _decisions(case: Case, field: Field) -> tuple[Decision, Decision]:
    wishes = tuple(Wish(effect, Mode.AUTO) for effect in (*case.before, case.effect))
    summary = field.summary(case)
    here = decide(EffectWishes(wishes), summary, _camera(120.0)).decisions[-1]
    quiet = EffectWishes((Wish(case.quiet.effect, Mode.AUTO),))
    there = decide(quiet, SceneSummary(case.quiet.largest), _camera(case.quiet.rim_deg))
    return here, there.decisions[-1]


def _draw(page: style.Page, case: Case, field: Field, here: Decision, there: Decision) -> None:
    without = srgb_from_linear(field.light(case, case.before))
    with_it = srgb_from_linear(field.light(case, (*case.before, case.effect)))
    difference = with_it - without
    gain = _gain(_middle(difference, case.zoom))
    pictures = (without, with_it, 0.5 + gain * difference)
    titles = ("without", f"with {case.effect.name}", f"difference, grey = none, times {gain}")
    for index, (shown, title) in enumerate(zip(pictures, titles, strict=True)):
        left = 20 + index * (_PANEL_PX + 20)
        style.words(page, left, 18, title, fontweight="bold")
        style.picture(page, _greys(_middle(shown, case.zoom)), left, 56, _PANEL_PX)
    style.words(page, 20, 560, f"{case.words}: {_told(here)}", color=style.TEAL)
    style.words(page, 20, 604, f"{case.quiet.words}: {_told(there)}", color=style.QUIET)


def _told(decision: Decision) -> str:
    state, sign = ("on", ">") if decision.is_on else ("off", "≤")
    numbers = f"{decision.bound:.3g} {sign} {decision.threshold:g} {decision.unit}"
    return f"{state}, {numbers} ({decision.reason})"


def _middle(values: Floats, zoom: int) -> Floats:
    """Return the part of a picture that is shown: around a goal, where it is enlarged."""
    if zoom == 1:
        return values
    side = _SIDE_PX // zoom
    row, column = _DETAIL
    return values[row : row + side, column : column + side]


# Top left corner of the enlarged part: the yellow goal and the line before it.
_DETAIL = (120, 264)


def _gain(difference: Floats) -> int:
    """Return by what power of two a difference is shown: the most that is not clipped much."""
    largest = float(np.quantile(np.abs(difference), 0.999))
    return int(2 ** np.floor(np.log2(0.5 / max(largest, 1e-4)))) if largest < 0.5 else 1


def _greys(encoded: Floats) -> Image:
    greys: Image = np.rint(255.0 * np.clip(encoded, 0.0, 1.0)).astype(np.uint8)
    return greys


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw all pages; return 0."""
    parser = argparse.ArgumentParser(
        prog="python -m catoptra_server.figures.effects",
        description="Draw what each effect does where it is called for, and tell where it is not.",
    )
    parser.add_argument("--output", type=Path, required=True, metavar="DIR")
    parsed = parser.parse_args(arguments)
    write_pages(parsed.output)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
