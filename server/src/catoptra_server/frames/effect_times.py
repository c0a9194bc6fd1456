"""Milliseconds of every effect that a frame draws.

Effects with a stage of their own have its time. All others change what the renderer traces or
rasterizes; their time is the difference between frames with and without them. Effects are added in
optical order, so that all times and the rest add up to the frame.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from statistics import median

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.effect import DecisionBasis, EffectMode, EffectSettings
from catoptra_server.effects.effect_plan import EffectDecision
from catoptra_server.frames.frame import ViewRequest
from catoptra_server.frames.plan.camera import CameraSpec
from catoptra_server.frames.views import RenderedView

# Of each kind of frame, by turns; the first prepares the view and fills caches.
_NUM_FRAMES = 9
_WARM_UP = 2


@dataclass(frozen=True, slots=True, eq=False)
class EffectTimes:
    """Times of a frame, which add up."""

    view: RenderedView
    """The frame with all effects."""
    effect_ms: Mapping[str, float]
    """Median milliseconds of each effect that the frame draws, in optical order."""
    other_ms: float
    """Median milliseconds of all else."""

    @property
    def frame_ms(self) -> float:
        """Milliseconds of the whole frame."""
        return self.other_ms + sum(self.effect_ms.values())


def measure_effect_times(
    render: Callable[[ViewRequest], RenderedView],
    request: ViewRequest,
    *,
    num_frames: int = _NUM_FRAMES,
    clock: Callable[[], float] = time.perf_counter,
) -> EffectTimes:
    """Measure the effects of a view.

    Args:
        render: Renders a view, as `ViewCache.render`.
        request: View of a camera with its effects.
        num_frames: Frames of each kind that count, beside two that do not.
        clock: Clock in seconds.
    """
    view = render(request)
    drawn = [one.effect for one in view.effect_decisions if acts_on_frame(one)]
    staged = [name for name in drawn if name in view.image.stage_ms]
    unstaged = [name for name in drawn if name not in view.image.stage_ms]
    # From none of them to all: each kind of frame has one more.
    requests = [_leave_out(request, unstaged[count:]) for count in range(len(unstaged) + 1)]
    rest_ms: list[list[float]] = [[] for _ in requests]
    stages_ms: dict[str, list[float]] = {name: [] for name in staged}
    for number in range(_WARM_UP + num_frames):
        # By turns, so that another load of the machine slows all of them alike.
        for variant, times in zip(requests, rest_ms, strict=True):
            begin_s = clock()
            rendered = render(variant)
            stage_ms = rendered.image.stage_ms
            staged_ms = sum(stage_ms.get(name, 0.0) for name in staged)
            if number >= _WARM_UP:
                times.append(1e3 * (clock() - begin_s) - staged_ms)
        if number >= _WARM_UP:
            for name in staged:
                stages_ms[name].append(stage_ms.get(name, 0.0))
    cumulative = _limit_by_later([median(times) for times in rest_ms])
    effect_ms = {name: median(times) for name, times in stages_ms.items()}
    effect_ms |= {
        name: after - before
        for name, before, after in zip(unstaged, cumulative, cumulative[1:], strict=False)
    }
    return EffectTimes(view, {name: effect_ms[name] for name in drawn}, cumulative[0])


def acts_on_frame(decision: EffectDecision) -> bool:
    """Whether a frame draws an effect: where it is on, and where the frame itself decided."""
    return decision.enabled or decision.basis is DecisionBasis.MEASURED


def _leave_out(request: ViewRequest, names: Sequence[str]) -> ViewRequest:
    """Same view without some of its effects."""
    camera = request.camera
    if not names:
        return request
    settings = tuple(
        replace(one, mode=EffectMode.NEVER) if one.effect.name in names else one
        for one in camera.effect_settings.settings
    )
    fewer: EffectSettings = replace(camera.effect_settings, settings=settings)
    bare: CameraSpec = replace(camera, effect_settings=fewer)
    return replace(request, camera=bare)


def _limit_by_later(times_ms: Sequence[float]) -> list[float]:
    """Times of frames with ever more effects, none above that of a frame with more.

    The whole frame keeps its own time: what the noise of a measurement takes from one effect, it
    gives to the one before.
    """
    limited = [times_ms[-1]]
    for one in reversed(times_ms[:-1]):
        limited.append(min(one, limited[-1]))
    return limited[::-1]
