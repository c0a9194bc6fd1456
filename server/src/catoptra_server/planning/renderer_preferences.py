"""Renderers of cameras without an accuracy target, by frames measured on this machine.

The first frames follow the rule of `renderer_rule`, or times kept from an earlier run. Medians of
drawn frames then decide whether the other renderer could be faster; if so, `frames.renderer_trial`
draws frames of both in turn. Only a clear advantage changes the renderer.
"""

from __future__ import annotations

import statistics
from collections import deque
from collections.abc import Mapping
from dataclasses import field

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.lru_dict import LruDict
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.planning.cost_cache import CostCache
from catoptra_server.planning.renderer_rule import ImageLoad, RendererRule
from catoptra_server.render.renderer_kind import RendererKind

FrameTimes = Mapping[RendererKind, float]  # median milliseconds of a frame

WINDOW_FRAMES = 30
# The other renderer has to be a fifth faster: less is no gain, and medians of seven frames on a
# machine with other work differ by a tenth.
SWITCH_FRACTION = 0.8
# The rule's machine may be half as fast as this one: the other renderer is tried where the rule's
# time of it is below one and a half times the drawn frames' median.
_RULE_MARGIN = 1.5
# Frames before a renderer that was measured as slower is tried again, where frames have become
# slower than its own; doubled by each trial in vain.
_RETRY_FRAMES = 1000


@dataclass(slots=True)
class _CameraTimes:
    """Drawn and measured times of one camera."""

    drawn_ms: deque[float] = field(default_factory=lambda: deque(maxlen=WINDOW_FRAMES))
    measured: dict[RendererKind, float] = field(default_factory=dict)
    origin: str = ""
    """Origin of the measured times, in words."""
    frames_to_wait: int = 0
    retry_frames: int = _RETRY_FRAMES
    is_abandoned: bool = False
    """Whether a renderer failed in a trial: the camera is not compared again."""


# Cameras by zoom and tile.
_MAX_CAMERAS = 64


class RendererPreferences:
    """Measured frame times of the cameras of one scene, and the renderers that follow from them."""

    def __init__(self, rule: RendererRule | None, cache: CostCache | None, device: str) -> None:
        """Create preferences without any frame.

        Args:
            rule: Rule of the scene; None where the choice is final.
            cache: Times that earlier servers measured; None for none.
            device: Description of the renderer that the rule chose: kept times belong to it.
        """
        self._rule = rule
        self._cache = cache
        self._device = device
        self._cameras: LruDict[OmniCameraSpec, _CameraTimes] = LruDict(_MAX_CAMERAS)

    def choose(
        self, camera: OmniCameraSpec, default: RendererKind, reason: str
    ) -> tuple[RendererKind, str]:
        """Renderer of a camera, and the reason.

        Args:
            camera: Camera to render.
            default: Renderer where nothing is measured.
            reason: Reason of the default.
        """
        times = self._find(camera)
        if times is None or default not in times.measured:
            return default, reason
        kind = fastest(times.measured, default)
        text = ", ".join(f"{one.value} {ms:.1f} ms" for one, ms in times.measured.items())
        return kind, f"{text} a frame, measured {times.origin}"

    def record_frame(self, camera: OmniCameraSpec, frame_ms: float) -> None:
        """Record the time of a drawn frame."""
        times = self._find(camera)
        if times is not None:
            times.drawn_ms.append(frame_ms)
            times.frames_to_wait = max(times.frames_to_wait - 1, 0)

    def find_rival(self, camera: OmniCameraSpec, kind: RendererKind) -> RendererKind | None:
        """Other renderer that could be clearly faster than a camera's own; None for none."""
        times = self._find(camera)
        if self._rule is None or times is None or times.is_abandoned or times.frames_to_wait:
            return None
        if len(times.drawn_ms) < WINDOW_FRAMES:
            return None
        limit_ms = statistics.median(times.drawn_ms)
        expected = {one: self._expect_ms(camera, times, one) for one in RendererKind if one != kind}
        return next((one for one, ms in expected.items() if ms is not None and ms < limit_ms), None)

    def _expect_ms(
        self, camera: OmniCameraSpec, times: _CameraTimes, kind: RendererKind
    ) -> float | None:
        """Frame time above which a renderer is tried; None for one that cannot be tried."""
        if kind in times.measured:
            return times.measured[kind] / SWITCH_FRACTION
        assert self._rule is not None, "without a rule nothing is tried"
        image = ImageLoad.from_camera(camera.camera, camera.render_settings, camera.effect_settings)
        ms = self._rule.predict_frame_ms(kind, image)
        return None if ms is None else ms / _RULE_MARGIN

    def record_comparison(self, camera: OmniCameraSpec, measured: FrameTimes) -> None:
        """Record the times of frames that both renderers drew in turn."""
        times = self._find(camera)
        assert times is not None, "only cameras with drawn frames are compared"
        times.measured, times.origin = dict(measured), "in turn on this machine"
        times.drawn_ms.clear()
        times.frames_to_wait, times.retry_frames = times.retry_frames, 2 * times.retry_frames
        if self._cache is not None:
            groups = {kind.value: {"frame": (ms,)} for kind, ms in measured.items()}
            self._cache.write(self._make_key(self._cache, camera), groups)

    def abandon(self, camera: OmniCameraSpec) -> None:
        """Compare a camera no more: a renderer failed."""
        times = self._find(camera)
        if times is not None:
            times.is_abandoned = True

    def _find(self, camera: OmniCameraSpec) -> _CameraTimes | None:
        """Times of a camera, those of an earlier run at first; None where the choice is final."""
        settings = camera.render_settings
        if self._rule is None or settings.accuracy_target.is_set or settings.renderer:
            return None
        return self._cameras.get_or_make(camera, lambda: self._read(camera))

    def _read(self, camera: OmniCameraSpec) -> _CameraTimes:
        groups = self._cache.read(self._make_key(self._cache, camera)) if self._cache else None
        try:
            measured = {
                RendererKind(name): stages["frame"][0] for name, stages in (groups or {}).items()
            }
        except (ValueError, KeyError, IndexError):  # a file of another form
            measured = {}
        return _CameraTimes(measured=measured, origin="in an earlier run")

    def _make_key(self, cache: CostCache, camera: OmniCameraSpec) -> str:
        assert self._rule is not None, "without a rule nothing is kept"
        # The scene by its numbers: hashing a million triangles would delay the first frame.
        return cache.make_key_of("comparison", self._device, self._rule, camera)


def fastest(measured: FrameTimes, default: RendererKind) -> RendererKind:
    """Renderer with a clear advantage over the default one, else the default."""
    kind = min(measured, key=lambda one: measured[one])
    return kind if measured[kind] < SWITCH_FRACTION * measured[default] else default
