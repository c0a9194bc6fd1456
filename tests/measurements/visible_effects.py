"""What a classifier, a filter and a person notice of effects that MaxChange and VisibleShare omit.

Run: OPENBLAS_NUM_THREADS=1 .venv/bin/python tests/measurements/visible_effects.py [--seeds 20]

A run is a seed: places drawn in each world, the robot driving or turning, the real camera of
configs/robots/p2at_omni_real.ini. Each frame is drawn with everything on, and once more for each
set of effects that some pair of the two numbers leaves out by the frame's own changes. Missed are
the beacons of the field within 4.5 m that the client's detector does not find; it is trained on
frames with everything on. Bearing errors are rms over the found ones. SSIM is against everything
on, of the luminance in the mirror's pixels (Wang et al. 2004, windows of sigma 1.5 px), the mean
over frames and the least of any. Intervals are 95 % of the mean over the runs (Student). The table
is printed, the figure goes to --folder. Processor milliseconds of a frame by three rules come
first, medians of frames drawn in turns.
"""

from __future__ import annotations

import argparse
import math
import statistics
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from catoptra_client.landmarks import Detector, Viewpoint, detect, label_frame, make_detector, train
from catoptra_protocol.optics.numerics import wrap_angle
from catoptra_server.commands.explain import build_camera_state
from catoptra_server.config.known_names import find_configuration
from catoptra_server.config.startup import StartupConfig, read_startup_config
from catoptra_server.effects import EffectChange, EffectMode, EffectSettings, Threshold
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.effects.kernels.grey_levels import valid_pixels
from catoptra_server.frames.frame import ViewRequest
from catoptra_server.frames.plan.camera import OmniCameraSpec
from catoptra_server.frames.plan.planner import RenderPlanner
from catoptra_server.frames.renderers import RendererPool, choose_renderer
from catoptra_server.frames.views import RenderedView, ViewCache
from catoptra_server.simulation.robot_description import PlanarPose
from catoptra_server.world.objects import CameraState, NoiseSeed
from catoptra_studies import plot_style
from catoptra_studies.effects.decision_experiment import MOTIONS, choose_places

MAX_CHANGES = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
SHARES = (0.0, 0.001, 0.01, 0.1, 1.0)
FIELD = "four_legged_2006"
FRAMES = {FIELD: 4, "rescue": 1, "warehouse": 1}
BEACON_RANGE_M = 4.5
TRAINING_SEED, TRAINING_FRAMES = 1000, 12
COST_RULES = ((0.5, 0.0), (2.0, 1.0), (8.0, 1.0))
COLOURS = (
    plot_style.FOREGROUND,
    plot_style.BLUE,
    plot_style.TEAL,
    plot_style.ORANGE,
    plot_style.RED,
)

Rule = tuple[float, float]
Picture = np.ndarray[Any, np.dtype[np.uint8]]


@dataclass(frozen=True, slots=True)
class FrameResult:
    """One frame by one rule; None for everything on."""

    rule: Rule | None
    world: str
    seed: int
    off: tuple[str, ...]
    near: int
    missed: int
    bearing_errors_rad: tuple[float, ...]
    ssim: float


class World:
    """A bundled world with the robot and its real camera."""

    def __init__(self, name: str) -> None:
        """Read the world."""
        robots = [find_configuration("robots", "p2at_omni_real")]
        self.name = name
        self.startup: StartupConfig = read_startup_config(
            robots, find_configuration("worlds", name)
        )
        scene, world = self.startup.scene, self.startup.world
        pool = RendererPool(choose_renderer("trace", scene, world, threads=1))
        self._views = ViewCache(RenderPlanner(pool), SceneSummarizer(scene, world))
        self.robot = self.startup.robots[0]
        assert self.robot.omni_camera is not None
        self.omni = self.robot.omni_camera

    def place(self, seed: int, count: int) -> list[tuple[PlanarPose, CameraState]]:
        """Poses of a run, and the camera's states there."""
        states = []
        for place in choose_places(self.name, self.startup, count, seed=seed):
            motion = ("driving", "turning")[place.number % 2]
            state = build_camera_state(self.robot, self.omni, place.pose, MOTIONS[motion])
            seeded = replace(state, noise_seed=NoiseSeed((1, seed), place.number))
            states.append((place.pose, seeded))
        return states

    def measure(self, state: CameraState) -> tuple[EffectDecision, ...]:
        """Decisions with both numbers of every effect that the frame measures."""
        # Nothing is left out, and no count ends.
        effects = replace(self.omni.effects, max_change=255.0, visible_share=1.0 - 1e-9)
        return self.render(state, effects).effect_decisions

    def draw(self, state: CameraState, off: frozenset[str]) -> Picture:
        """Picture with everything on but some effects."""
        settings = tuple(
            replace(one, mode=EffectMode.NEVER if one.effect.name in off else EffectMode.ALWAYS)
            for one in self.omni.effects.settings
            if one.mode is not EffectMode.NEVER
        )
        return self.render(state, EffectSettings(settings)).image.rgb

    def render(self, state: CameraState, effects: EffectSettings) -> RenderedView:
        """Frame with some effects."""
        spec = OmniCameraSpec(self.omni.camera, self.omni.render_settings, effects)
        return self._views.render(ViewRequest(spec, state))


def train_detector(world: World) -> Detector:
    """The client's detector, of frames with everything on."""
    camera, landmarks = world.omni.camera, world.startup.world.landmarks
    frames = [
        (
            world.draw(state, frozenset()),
            label_frame(camera, landmarks, world_from_mirror=state.world_from_mirror),
        )
        for _, state in world.place(TRAINING_SEED, TRAINING_FRAMES)
    ]
    height_m = -float(world.place(0, 1)[0][1].world_from_mirror.translation[2])
    return make_detector(camera, train(frames), landmarks=landmarks, viewpoint=Viewpoint(height_m))


def find_off(decisions: Sequence[EffectDecision], rule: Rule) -> frozenset[str]:
    """Effects that a rule leaves out."""
    threshold = Threshold(rule[0], visible_share=rule[1])
    return frozenset(
        one.effect
        for one in decisions
        # What is seen without a number stays on; what another effect includes goes with that one.
        if not (one.enabled and one.change is None)
        and threshold.covers(
            EffectChange(one.bound if one.change is None else one.change, one.visible_share)
        )
    )


def find_beacons(
    detector: Detector, pose: PlanarPose, picture: Picture
) -> tuple[int, int, tuple[float, ...]]:
    """Beacons in reach, those that are missed, and the bearing errors of the others, rad."""
    found = {one.name: one for one in detect(detector, picture) if one.has_range}
    near, errors = 0, []
    for landmark in detector.landmarks:
        dx, dy = landmark.x_m - pose.x_m, landmark.y_m - pose.y_m
        if landmark.kind != "beacon" or math.hypot(dx, dy) > BEACON_RANGE_M:
            continue
        near += 1
        if landmark.name in found:
            bearing = math.atan2(dy, dx) - pose.yaw_rad
            errors.append(float(wrap_angle(found[landmark.name].bearing_rad - bearing)))
    return near, near - len(errors), tuple(errors)


def compare(one: Picture, other: Picture, mask: np.ndarray[Any, Any]) -> float:
    """SSIM of the luminance of two pictures, over a mask."""
    a, b = (cv2.cvtColor(p, cv2.COLOR_RGB2GRAY).astype(np.float64) for p in (one, other))

    def blur(image: Any) -> Any:
        return cv2.GaussianBlur(image, (11, 11), 1.5)

    mean_a, mean_b = blur(a), blur(b)
    var_a, var_b = blur(a * a) - mean_a**2, blur(b * b) - mean_b**2
    covariance = blur(a * b) - mean_a * mean_b
    c1, c2 = (0.01 * 255.0) ** 2, (0.03 * 255.0) ** 2
    ssim = (2.0 * mean_a * mean_b + c1) * (2.0 * covariance + c2)
    ssim /= (mean_a**2 + mean_b**2 + c1) * (var_a + var_b + c2)
    return float(ssim[mask].mean())


def run_seed(worlds: Sequence[World], detector: Detector, seed: int) -> list[FrameResult]:
    """All frames of a run by all rules."""
    rules = [(change, share) for change in MAX_CHANGES for share in SHARES]
    results = []
    for world in worlds:
        mask = valid_pixels(world.omni.camera)
        for pose, state in world.place(seed, FRAMES[world.name]):
            decisions = world.measure(state)
            off_by_rule = {None: frozenset[str](), **{r: find_off(decisions, r) for r in rules}}
            whole = world.draw(state, frozenset())
            known: dict[frozenset[str], tuple[Any, ...]] = {}
            for rule, off in off_by_rule.items():
                if off not in known:
                    picture = world.draw(state, off)
                    beacons = (0, 0, ())
                    if world.name == FIELD:
                        beacons = find_beacons(detector, pose, picture)
                    known[off] = (*beacons, compare(picture, whole, mask))
                results.append(FrameResult(rule, world.name, seed, tuple(sorted(off)), *known[off]))
    return results


def mean_with_interval(values: Sequence[float]) -> tuple[float, float]:
    """Mean over the runs, and half of its 95 % interval."""
    count = len(values)
    # Student's t of 19 degrees of freedom: the shipped figure has 20 runs.
    return statistics.fmean(values), 2.093 * statistics.stdev(values) / math.sqrt(count)


def summarize(frames: Sequence[FrameResult]) -> dict[str, list[float]]:
    """Quantities of one rule, run by run."""
    found: dict[str, list[float]] = {
        "missed": [],
        "bearing": [],
        "ssim": [],
        "least": [],
        "off": [],
    }
    for seed in sorted({one.seed for one in frames}):
        run = [one for one in frames if one.seed == seed]
        errors = [error for one in run for error in one.bearing_errors_rad]
        found["missed"].append(100.0 * sum(r.missed for r in run) / sum(r.near for r in run))
        found["bearing"].append(math.degrees(math.sqrt(statistics.fmean(e * e for e in errors))))
        found["ssim"].append(statistics.fmean(one.ssim for one in run))
        found["least"].append(min(one.ssim for one in run))
        found["off"].append(statistics.fmean(len(one.off) for one in run))
    return found


def report(results: Sequence[FrameResult], folder: Path) -> None:
    """Print the table, and draw the figure."""
    by_rule: dict[Rule | None, dict[str, list[float]]] = {
        rule: summarize([one for one in results if one.rule == rule])
        for rule in dict.fromkeys(one.rule for one in results)
    }
    print("| MaxChange | VisibleShare | off | missed, % | bearing error, deg | SSIM | least |")
    print("|---|---|---|---|---|---|---|")
    for rule, found in by_rule.items():
        change, share = ("-", "-") if rule is None else (f"{rule[0]:g}", f"{rule[1]:g}")
        missed, bearing, ssim, _, off = (mean_with_interval(found[name]) for name in found)
        print(
            f"| {change} | {share} | {off[0]:.1f} | {missed[0]:.2f} ± {missed[1]:.2f} | "
            f"{bearing[0]:.4f} ± {bearing[1]:.4f} | {ssim[0]:.4f} | {min(found['least']):.4f} |"
        )
    draw_figure(by_rule, folder / "visible-effects.png")


PANELS = {
    "off": "effects left out",
    "missed": "beacons missed, %",
    "bearing": "bearing error, degrees",
    "least": "least SSIM",
}


def draw_figure(by_rule: Mapping[Rule | None, dict[str, list[float]]], path: Path) -> None:
    """Draw each quantity against both numbers; grey: interval with everything on."""
    with plot_style.open_chart(path, figsize=(7.6, 4.4)) as chart:
        panels = chart.subplots(2, 2).ravel()
        for axes, (name, text) in zip(panels, PANELS.items(), strict=True):
            mean, half = mean_with_interval(by_rule[None][name])
            if name in ("missed", "bearing"):
                axes.axhspan(mean - half, mean + half, color=plot_style.LIGHT_GREY)
            for share, colour in zip(SHARES, COLOURS, strict=True):
                values = [by_rule[change, share][name] for change in MAX_CHANGES]
                shown = [min(v) if name == "least" else statistics.fmean(v) for v in values]
                label = f"VisibleShare {share:g}" if name == "off" else None
                axes.plot(MAX_CHANGES, shown, color=colour, marker="o", markersize=3, label=label)
            axes.set_xscale("log", base=2)
            axes.set_xticks(MAX_CHANGES, [f"{change:g}" for change in MAX_CHANGES])
            axes.set(xlabel="MaxChange, levels", ylabel=text)
        panels[1].set_ylim(-0.2, 5.0)
        plot_style.add_legend(chart, panels[0], loc="outside lower center", ncols=len(SHARES))


def measure_cost(worlds: Sequence[World], repeats: int) -> None:
    """Print processor milliseconds of a frame by rule, drawn in turns."""
    for world in worlds:
        _, state = world.place(0, 1)[0]
        times: dict[Rule, list[float]] = {rule: [] for rule in COST_RULES}
        for _ in range(repeats):
            for rule in COST_RULES:
                effects = replace(world.omni.effects, max_change=rule[0], visible_share=rule[1])
                begin_s = time.process_time()
                world.render(state, effects)
                times[rule].append(1e3 * (time.process_time() - begin_s))
        medians = (f"{rule}: {statistics.median(ms[2:]):.1f}" for rule, ms in times.items())
        print(f"{world.name}, processor ms: {', '.join(medians)}")


def main() -> None:
    """Run, and write results, table and figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--repeats", type=int, default=20)
    parser.add_argument("--folder", type=Path, default=Path("out/visible_effects"))
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    worlds = [World(name) for name in FRAMES]
    measure_cost(worlds, arguments.repeats)
    detector = train_detector(worlds[0])
    results: list[FrameResult] = []
    for seed in range(arguments.seeds):
        results += run_seed(worlds, detector, seed)
        print(f"seed {seed}: {len(results)} results", flush=True)
    report(results, arguments.folder)


if __name__ == "__main__":
    main()
