"""Checks of rendering plans, bounds, targets, variants and effects of frames on the stream.

The plan by set_accuracy and the frames that it renders state the same numbers; differences and
effects are computed again from the pictures.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from catoptra_client.frame import Frame
from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_protocol.stream.replies import FrameHeader, PlanAlternative, PlanReply
from catoptra_protocol.stream.requests import (
    FrameVariant,
    GetFrameRequest,
    ImageEncoding,
    SetAccuracyRequest,
)
from conformance.check import Check, CheckFailed, CheckSkipped, ServerUnderTest, check_from_function
from conformance.image_checks import require_equal_pictures
from conformance.stream_session import StreamRobot, ask, require, spawn_on_stream
from conformance.stream_state_checks import get_header

Levels = npt.NDArray[np.int16]

# Numbers are stated as doubles; costs are corrected by each frame.
_RELATIVE_TOLERANCE, _COST_TOLERANCE = 1e-6, 0.05
_PARTS = ("polygons_px", "rim_px", "faces_px", "corners_px", "rounding_px", "scene_px")
# Rounding of two encoded pictures, in levels.
_ROUNDING_LEVELS = 1.5
_MAX_EFFECTS = 6
_MAX_FRAMES = 40
_EASY_PX, _HARD_PX = 2.0, 1e-4


def check_bound(server: ServerUnderTest) -> None:
    """Bounds of frames are sums of their parts, those of the plan, and follow the samples."""
    with spawn_on_stream(server) as robot:
        frame, first = robot.get_frame(), get_header(robot)
        is_hyperbolic = (first.camera_model or {}).get("Mirror") == "hyperbolic"
        if not (isinstance(frame.camera, OmniCamera) and is_hyperbolic):
            raise CheckSkipped("only cameras with a hyperbolic mirror have a bound in any case")
        camera = frame.camera_name or ""
        header, plan = _get_header(robot, camera, None), _set_accuracy(robot, None, None)
        by_samples = {
            samples: _get_header(robot, camera, FrameVariant(samples=samples, polygons=0))
            for samples in (1, 3)
        }
        meshed = _get_header(robot, camera, FrameVariant(samples=1, polygons=64))
    for one in (header, *by_samples.values(), meshed):
        _require_bounds(one.error_bound_px, one.error_bounds, frame.camera)
    _require_bounds(plan.error_bound_px, plan.error_bounds, frame.camera)
    _require_close_maps(plan.error_bounds or {}, header.error_bounds or {}, "bounds of the plan")
    require(plan.camera, camera, "camera of a plan")
    require(plan.plan, header.plan, "plan of frames")
    for samples, one in by_samples.items():
        edge_px = (one.error_bounds or {})["edge_px"]
        if not math.isclose(edge_px, math.sqrt(0.5) / samples, rel_tol=_RELATIVE_TOLERANCE):
            raise CheckFailed(f"edge_px of {samples} x {samples} samples is {edge_px:g}")
        _require_larger(meshed, one)
    require(len({one.plan for one in (*by_samples.values(), meshed)}), 3, "plans of three variants")


def check_targets(server: ServerUnderTest) -> None:
    """Plans and frames of an accuracy target state it, and whether they meet it, alike."""
    with spawn_on_stream(server) as robot:
        plain = _require_omni(robot)
        camera = plain.camera
        free = _set_accuracy(robot, 0.0, 0.0)
        easy, met = _set_accuracy(robot, _EASY_PX, 0.0), _get_target_frame(robot)
        after_easy = _set_accuracy(robot, None, None)
        hard, missed = _set_accuracy(robot, _HARD_PX, None), _get_target_frame(robot)
        after_hard = _set_accuracy(robot, None, None)
        budget = _set_accuracy(robot, 0.0, 1000.0)
        durations = [sum(_get_target_frame(robot).stage_ms.values()) for _ in range(6)]
        last = _set_accuracy(robot, None, None)
        end = _set_accuracy(robot, 0.0, 0.0)
    require((free.max_error_px, free.budget_ms, free.cost_ms), (0.0, 0.0, None), "no target")
    require((free.more_accurate, free.faster, free.target_met), (None, None, True), "no target")
    plans = easy, after_easy, hard, after_hard, budget, last
    for plan in plans:
        _require_order(plan)
        _require_bounds(plan.error_bound_px, plan.error_bounds, camera)
        require(bool(plan.plan), True, "a description of the plan")
    targets = [(one.max_error_px, one.budget_ms) for one in plans]
    expected = [(_EASY_PX, 0.0)] * 2 + [(_HARD_PX, 0.0)] * 2 + [(0.0, 1000.0)] * 2
    require(targets, expected, "tolerances and budgets")
    is_met = [one.target_met for one in (easy, after_easy, met, hard, after_hard, missed)]
    require(is_met, [True] * 3 + [False] * 3, "target_met of plans and frames")
    require((easy.error_bound_px or math.inf) <= _EASY_PX, True, f"a bound within {_EASY_PX} px")
    require((hard.error_bound_px or 0.0) > _HARD_PX, True, f"a bound above {_HARD_PX} px")
    for frame, before, after in ((met, easy, after_easy), (missed, hard, after_hard)):
        _require_close_maps(after.error_bounds or {}, frame.error_bounds or {}, "bounds")
        _require_cost(frame.predicted_ms, (before.cost_ms, after.cost_ms), "predicted_ms")
        for name in ("more_accurate", "faster"):
            _require_alternative(
                getattr(frame, name), getattr(before, name), getattr(after, name), name
            )
    stated = [one.median_frame_ms for one in (free, *plans, end)]
    medians = [one for one in stated if one is not None]
    drawn = [*durations, *(sum(one.stage_ms.values()) for one in (plain, met, missed))]
    for median_ms in medians:
        # Some were drawn before, while the machine was less busy or more.
        is_near = min(drawn) / 4.0 <= median_ms <= 4.0 * max(drawn)
        require(is_near, True, f"median {median_ms:g} ms of frames of {drawn} ms")


def check_difference(server: ServerUnderTest) -> None:
    """Numbers of a difference are those of the image that shows it, beside the picture."""
    with spawn_on_stream(server) as robot:
        plain = _require_omni(robot)
        camera = plain.camera_name or ""
        variants = {name: FrameVariant(reference=name) for name in ("exact", "camera")}
        coarse = FrameVariant(samples=1, polygons=0, reference="exact")
        frames = {name: _get_frame(robot, camera, one) for name, one in variants.items()}
        frames["coarse"] = _get_frame(robot, camera, coarse)
    for name, frame in frames.items():
        numbers, image = frame.difference, frame.difference_rgb
        if numbers is None or image is None:
            raise CheckFailed(f"no difference of the reference {name}")
        levels = image.astype(np.float64)
        observed = numbers.max_levels, numbers.rms_levels, numbers.changed_fraction
        expected = (
            int(levels.max()),
            float(np.sqrt((levels**2).mean())),
            float((levels > 0).any(axis=-1).mean()),
        )
        if not np.allclose(observed, expected, rtol=1e-4, atol=1e-6):
            raise CheckFailed(f"the difference {observed} of {name}, by its image {expected}")
        require(bool(numbers.reference_plan), True, "reference_plan")
    same = frames["camera"].difference
    require(same is not None and same.max_levels, 0, "difference from the camera's own settings")
    require_equal_pictures(plain.rgb, frames["exact"].rgb, "plain picture and that of a difference")
    plans = {name: one.difference.reference_plan for name, one in frames.items() if one.difference}
    require(plans["exact"], plans["coarse"], "reference_plan of the exact model")


def check_hands(server: ServerUnderTest) -> None:
    """Of the pictures mirrored and flipped one is the camera's own, the other its reflection."""
    with spawn_on_stream(server) as robot:
        plain = _require_omni(robot)
        camera = plain.camera_name or ""
        frames = [
            _get_frame(robot, camera, FrameVariant(picture=name))
            for name in ("mirrored", "flipped")
        ]
    own = [one.camera == plain.camera for one in frames]
    require(sorted(own), [False, True], "camera models of the hands equal to the camera's own")
    for frame, is_own in zip(frames, own, strict=True):
        expected = plain.rgb if is_own else plain.rgb[:, ::-1]
        require_equal_pictures(np.ascontiguousarray(expected), frame.rgb, "pictures of both hands")


def check_effects(server: ServerUnderTest) -> None:
    """Effects are enabled where they change a picture by more than the threshold, and only then."""
    with spawn_on_stream(server) as robot:
        camera = _require_omni(robot).camera_name or ""
        named = robot.get_frame().effects
        if not named:
            raise CheckSkipped("the camera names no effects")
        names = [one.name for one in named]
        auto, never = (dict.fromkeys(names, mode) for mode in ("auto", "never"))
        decided, plain = (
            _get_frame(robot, camera, FrameVariant(effects=one)) for one in (auto, never)
        )
        changed = {}
        # Random numbers would differ from frame to frame.
        for name in [one for one in names if "Noise" not in one][:_MAX_EFFECTS]:
            modes = [{**never, name: mode} for mode in ("always", "never")]
            modes = [{**modes[0], name: "auto"}, *modes]
            changed[name] = [_get_frame(robot, camera, FrameVariant(effects=one)) for one in modes]
    require(len(set(names)) == len(names) and all(names), True, f"names of effects {names}")
    require([one.name for one in decided.effects], names, "names of effects")
    require([one.enabled for one in plain.effects], [False] * len(names), "effects in mode never")
    for frame in (decided, plain, *itertools.chain(*changed.values())):
        stages = frame.stage_ms or {}
        total_s = sum(stages.values()) / 1000.0
        is_right = min(stages.values()) >= 0.0 < total_s <= (frame.age_s or 0.0)
        require(is_right, True, f"stages {stages} of a frame {frame.age_s} s old")
        for one in frame.effects:
            _require_record(one, stages)
    for one in decided.effects:
        size = one.bound if one.change is None else one.change
        is_missed = size > one.threshold or one.visible_share > one.share_threshold
        if one.enabled != is_missed:
            raise CheckFailed(f"of the threshold {one.threshold:g} the effect is {one}")
    for name, (own, always, without) in changed.items():
        by_mode = [
            next(one for one in frame.effects if one.name == name) for frame in (own, always)
        ]
        difference = abs(always.rgb.astype(np.int16) - without.rgb.astype(np.int16))
        change = float(difference.max())
        if change > by_mode[1].bound + _ROUNDING_LEVELS:
            raise CheckFailed(f"{name} changes a pixel by {change:g} levels: {by_mode[1]}")
        # It may be measured in single samples of a pixel, which change by more.
        measured = by_mode[0].change
        if measured is not None and not (
            change - _ROUNDING_LEVELS <= measured <= 2.0 * change + _ROUNDING_LEVELS
        ):
            raise CheckFailed(f"{name} changes a pixel by {change:g} levels: {by_mode[0]}")


def _require_record(one, stage_ms: Mapping[str, float]) -> None:
    """Fail where the numbers of an effect's decision contradict each other."""
    is_right = (
        min(one.bound, one.threshold, one.displacement_px or 0.0, one.change or 0.0) >= 0.0
        and one.bound <= 255.0
        and 0.0 <= one.visible_share <= 1.0
        and 0.0 <= one.share_threshold <= 1.0
        and (one.change or 0.0) <= 255.0
        and one.basis in ("proved", "measured")
        # Of the own robot is known that it is seen, not by how much.
        and (one.basis == "measured" or one.change is None)
        and (one.basis == "proved" or one.change is not None or one.name == "SelfView")
        and (one.enabled or one.duration_ms is None)
        and bool(one.reason)
    )
    if not is_right:
        raise CheckFailed(f"the effect is {one}")
    duration_ms = stage_ms.get(one.name) if one.enabled else None
    if (one.duration_ms is None) != (duration_ms is None) or not math.isclose(
        one.duration_ms or 0.0, duration_ms or 0.0, rel_tol=1e-3
    ):
        raise CheckFailed(f"{one.name} takes {one.duration_ms} ms, by stage_ms {stage_ms}")


def _require_bounds(
    bound_px: float | None, parts: Mapping[str, float] | None, camera: OmniCamera
) -> None:
    if bound_px is None or parts is None or not (math.isfinite(bound_px) and bound_px >= 0.0):
        raise CheckFailed(f"error_bound_px is {bound_px}: expected a finite number of at least 0")
    total = parts.get("max_px", math.nan) + parts.get("edge_px", math.nan)
    for name, value in (
        ("outline_px", parts.get("outline_px", math.nan)),
        ("max_px + edge_px", total),
    ):
        if not math.isclose(bound_px, value, rel_tol=_RELATIVE_TOLERANCE):
            raise CheckFailed(f"error_bound_px is {bound_px:g}, {name} of error_bounds {value:g}")
    applicable = [parts[name] for name in _PARTS if name in parts]
    is_right = (
        min(parts.values()) >= 0.0
        and parts["rms_px"] <= parts["max_px"]
        and parts["rms_deg"] <= parts["max_deg"]
        and bool(applicable)
        and max(applicable) <= parts["max_px"] * 1.000001 <= sum(applicable) * 1.00001
    )
    # An angle of a degree is between the smallest and the largest number of pixels of the image.
    px_per_deg = math.radians(1.0) * camera.horizon_radius_px
    is_right &= 0.1 < parts["max_px"] / (parts["max_deg"] * px_per_deg) < 10.0
    if not is_right:
        raise CheckFailed(f"the parts of a bound contradict each other: {dict(parts)}")


def _require_larger(meshed: FrameHeader, exact: FrameHeader) -> None:
    bounds = [one.error_bound_px or 0.0 for one in (meshed, exact)]
    require(
        bounds[0] > bounds[1], True, f"bound of flat polygons {bounds[0]:g} above {bounds[1]:g}"
    )


def _require_close_maps(one: Mapping[str, float], other: Mapping[str, float], name: str) -> None:
    require(set(one), set(other), name)
    for key in one:
        if not math.isclose(one[key], other[key], rel_tol=_RELATIVE_TOLERANCE):
            raise CheckFailed(f"{key} of the {name} is {one[key]:g}, of a frame {other[key]:g}")


def _require_order(plan: PlanReply) -> None:
    """Fail where the neighbours of a plan are not more accurate and dearer, or the opposite."""
    row = [
        (one.error_bound_px, one.cost_ms)
        for one in (plan.more_accurate, plan, plan.faster)
        if one is not None
    ]
    bounds, costs = zip(*row, strict=True)
    if None in bounds or None in costs or min(costs) <= 0.0 or min(bounds) <= 0.0:
        raise CheckFailed(f"a plan with a target has the bounds {bounds} and the costs {costs}")
    is_right = list(bounds) == sorted(bounds) and list(costs) == sorted(costs, reverse=True)
    is_right &= all(one is None or one.plan for one in (plan.more_accurate, plan.faster))
    if not is_right:
        raise CheckFailed(f"neighbours of a plan: the bounds {bounds} px, the costs {costs} ms")


def _require_alternative(
    one: PlanAlternative | None,
    before: PlanAlternative | None,
    after: PlanAlternative | None,
    name: str,
) -> None:
    if one is None or before is None or after is None:
        require(one in (before, after), True, f"{name} of frames {one}, of the plan {after}")
        return
    require(one.plan in (before.plan, after.plan), True, f"{name}: {one}, of the plan {after}")
    bounds = before.error_bound_px, after.error_bound_px
    is_near = any(math.isclose(one.error_bound_px, bound, rel_tol=1e-2) for bound in bounds)
    require(is_near, True, f"{name}: {one}, of the plan {after}")
    _require_cost(one.cost_ms, (before.cost_ms, after.cost_ms), f"cost_ms of {name}")


def _require_cost(one: float | None, others: tuple[float | None, float | None], name: str) -> None:
    """Fail where a cost is not between those of the plan before and after the frame."""
    numbers = [number for number in others if number is not None]
    if one is None or len(numbers) < 2:
        raise CheckFailed(f"{name} is {one} ms, by the plan {others}")
    low, high = min(numbers) * (1.0 - _COST_TOLERANCE), max(numbers) * (1.0 + _COST_TOLERANCE)
    require(low <= one <= high, True, f"{name} {one:g} ms, by the plan {others}")


def _require_omni(robot: StreamRobot) -> Frame:
    """Lossless frame of a standing robot with an omnidirectional camera."""
    time_s = robot.wait_until_standing()
    frame = robot.get_frame_after(time_s)
    if not isinstance(frame.camera, OmniCamera):
        raise CheckSkipped("only omnidirectional cameras have variants")
    return frame


def _get_frame(robot: StreamRobot, camera: str, variant: FrameVariant) -> Frame:
    return robot.client.get_frame(
        encoding=ImageEncoding.PNG, robot=robot.name, camera=camera, variant=variant
    )


def _get_header(robot: StreamRobot, camera: str, variant: FrameVariant | None) -> FrameHeader:
    values = robot.name, camera, ImageEncoding.JPEG, variant
    return ask(robot.client, GetFrameRequest, FrameHeader, *values)


def _get_target_frame(robot: StreamRobot) -> FrameHeader:
    """Header of a frame of the newest plan; one may be ready that an older one rendered."""
    target = _set_accuracy(robot, None, None)
    for _ in range(_MAX_FRAMES):
        header = _get_header(robot, "", None)
        if header.predicted_ms is not None and header.error_bound_px is not None:
            expected = target.error_bound_px or math.inf
            if math.isclose(header.error_bound_px, expected, rel_tol=0.05):
                return header
    raise CheckFailed(f"{_MAX_FRAMES} frames after set_accuracy are not of the plan {target.plan}")


def _set_accuracy(
    robot: StreamRobot, max_error_px: float | None, budget_ms: float | None
) -> PlanReply:
    return ask(robot.client, SetAccuracyRequest, PlanReply, "", max_error_px, budget_ms)


PLAN_CHECKS: tuple[Check, ...] = (
    check_from_function("stream_bound", "stream", check_bound),
    check_from_function("stream_targets", "stream", check_targets),
    check_from_function("stream_difference", "stream", check_difference),
    check_from_function("stream_hands", "stream", check_hands),
    check_from_function("stream_effects", "stream", check_effects),
)
