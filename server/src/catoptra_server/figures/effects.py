"""The command `python -m catoptra_server.figures.effects`: what each effect does, and when not.

A page an effect: the picture without it, with it, and their difference, in a scene that calls for
it; below, the criterion's words there and in a scene that does not. The pictures are the float64
references' on a traced linear picture.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
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
from catoptra_server.effects.auto_exposure import AutoExposure
from catoptra_server.effects.bayer import Bayer
from catoptra_server.effects.bloom import Bloom
from catoptra_server.effects.capture import Capture
from catoptra_server.effects.decide import Decision, decide
from catoptra_server.effects.effect import Effect, EffectWishes, Mode, Wish
from catoptra_server.effects.exposure import Exposure as ShutterTime
from catoptra_server.effects.fixed_pattern import FixedPattern
from catoptra_server.effects.frame_key import FrameKey
from catoptra_server.effects.mirror_reflectance import MirrorReflectance
from catoptra_server.effects.quantisation import Quantisation
from catoptra_server.effects.read_noise import ReadNoise
from catoptra_server.effects.scene_summary import SceneSummary
from catoptra_server.effects.shot_noise import ShotNoise
from catoptra_server.effects.vignetting import Vignetting
from catoptra_server.effects.white_balance import WhiteBalance
from catoptra_server.figures import style
from catoptra_server.plan.render_plan import RendererKind, plan_from_wish
from catoptra_server.render.renderer import Exposure, Image
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.robot.render_wish import RenderWish
from catoptra_server.scene.colour import srgb_from_linear
from catoptra_server.setup import read_setup

_SIDE_PX = 480
_PANEL_PX = 480
_CAPTURE = Capture(FrameKey((1, 2), 3))
_DIM = ShutterTime(0.004, 0.02)
_LONG = ShutterTime(0.06, 0.02)


@dataclass(frozen=True, slots=True)
class Quiet:
    """A scene that does not call for an effect: what is different there, in words."""

    words: str
    effect: Effect
    largest: float = 1.0
    rim_deg: float = 120.0


@dataclass(frozen=True, slots=True)
class Case:
    """What a page shows. before: effects in front of it. zoom: how much of the middle is shown."""

    effect: Effect
    quiet: Quiet
    words: str
    before: tuple[Effect, ...] = ()
    zoom: int = 1


CASES = (
    Case(
        MirrorReflectance(2.8, 3.4),
        Quiet(
            "the same steel with its rim at 40 degrees", MirrorReflectance(2.8, 3.4), rim_deg=40.0
        ),
        "a mirror of steel, n = 2.8, k = 3.4",
    ),
    Case(
        Vignetting(),
        Quiet("a mirror with its rim at 25 degrees", Vignetting(), rim_deg=25.0),
        "the paper's mirror by day",
    ),
    Case(
        _LONG,
        Quiet("the shutter open as long as white needs", ShutterTime(0.02, 0.02)),
        "60 ms where white needs 20 ms",
    ),
    Case(
        AutoExposure(0.18, 0.1, 10.0),
        Quiet("a camera with fixed gain", AutoExposure(0.18, 1.0, 1.0)),
        "a picture that was exposed for 4 ms instead of 20",
        before=(_DIM,),
    ),
    Case(
        Bloom(0.3, 40.0),
        Quiet("the same at the shutter time that white needs", Bloom(0.3, 40.0)),
        "60 ms where white needs 20 ms: wells run over",
        before=(_LONG,),
    ),
    Case(
        FixedPattern(0.02, 20.0, 18000.0),
        Quiet("a sensor even to a ten-thousandth", FixedPattern(1e-4, 0.1, 18000.0)),
        "2 % of gain and 20 electrons, 10 times enlarged",
        zoom=10,
    ),
    Case(
        ShotNoise(1800.0),
        Quiet("wells of a hundred million electrons", ShotNoise(1e8)),
        "wells of 1800 electrons, 10 times enlarged",
        zoom=10,
    ),
    Case(
        ReadNoise(13.0, 1800.0),
        Quiet("three hundredths of an electron", ReadNoise(0.03, 1800.0)),
        "13 electrons beside 1800 of white, 10 times enlarged",
        zoom=10,
    ),
    Case(
        Quantisation(5),
        Quiet("a converter of 12 bits", Quantisation(12)),
        "a converter of 5 bits",
    ),
    Case(
        Bayer(),
        Quiet("a night, a ten-thousandth of white", Bayer(), largest=1e-4),
        "the field by day, 10 times enlarged",
        zoom=10,
    ),
    Case(
        WhiteBalance(1.4, 0.75),
        Quiet("gains of one", WhiteBalance(1.0, 1.0)),
        "red times 1.4, blue times 0.75",
    ),
)


def write_pages(folder: Path) -> None:
    """Write a page a case, and the explanations as text, into a folder that is made if need be."""
    folder.mkdir(parents=True, exist_ok=True)
    light, summary = _field()
    lines = []
    for case in CASES:
        here, there = _decisions(case, summary)
        with style.page(style.PAGE_PX, 660) as page:
            _draw(page, case, light, here, there)
            style.save(page, folder / f"{case.effect.name}.png")
        lines += [f"{case.words}: {_told(here)}", f"{case.quiet.words}: {_told(there)}", ""]
    (folder / "explanations.txt").write_text("\n".join(lines), encoding="utf-8")


def _field() -> tuple[Floats, SceneSummary]:
    """Return the linear picture of the field from its first start, and its summary."""
    setup = read_setup(
        [configuration_file("robots", "p2at_omni")],
        configuration_file("worlds", "four_legged_2006"),
    )
    renderer = TraceRenderer(setup.scene, setup.world)
    camera = _camera(120.0)
    plan = plan_from_wish(
        RenderWish(samples=3), camera, kind=RendererKind.TRACE, why="for a figure"
    )
    exposure = Exposure(Pose.from_rpy((0.5, 0.3, -0.6), (0.0, 0.0, 0.3)))
    light = renderer.prepare(camera, plan).draw_linear(exposure)
    summary = renderer.summary(exposure, camera)
    renderer.close()
    return light.astype(np.float64), summary


def _camera(rim_deg: float) -> OmniCamera:
    return camera_with_rim_inscribed(
        HyperbolicMirror(11.546, 0.2321),
        width_px=_SIDE_PX,
        height_px=_SIDE_PX,
        rim_rad=float(np.radians(rim_deg)),
    )


def _decisions(case: Case, summary: SceneSummary) -> tuple[Decision, Decision]:
    wishes = tuple(Wish(effect, Mode.AUTO) for effect in (*case.before, case.effect))
    here = decide(EffectWishes(wishes), summary, _camera(120.0)).decisions[-1]
    quiet = EffectWishes((Wish(case.quiet.effect, Mode.AUTO),))
    there = decide(quiet, SceneSummary(case.quiet.largest), _camera(case.quiet.rim_deg))
    return here, there.decisions[-1]


def _draw(page: style.Page, case: Case, light: Floats, here: Decision, there: Decision) -> None:
    camera = _camera(120.0)
    for effect in case.before:
        light = effect.apply(light, camera, _CAPTURE)
    without = srgb_from_linear(light)
    with_it = srgb_from_linear(case.effect.apply(light, camera, _CAPTURE))
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
