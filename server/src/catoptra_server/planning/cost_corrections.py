"""Corrections of predicted frame times by drawn frames.

Drawn frames differ from calibrated ones in two ways. The load of the machine and the viewpoint
multiply all times of a renderer; stages that no calibration has, such as effects, add to them.
"""

from __future__ import annotations

from collections.abc import Container, Mapping

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.effect import EffectSettings
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.render.renderer_kind import RendererKind

# Real frames take a few times the measured time at most; a larger quotient comes from a suspended
# process or a changed clock, and is not believed.
_MAX_FACTOR = 10.0
# In place of the calibrated stages, in frames of several time samples.
_MULTIPLIED_STAGES = frozenset({"accumulate"})

_EffectsKey = tuple[OmniCamera, EffectSettings]


def added_ms(stage_ms: Mapping[str, float], calibrated_stages: Container[str]) -> float:
    """Milliseconds of a frame's stages that no calibration has, such as effects."""
    return sum(
        ms
        for stage, ms in stage_ms.items()
        if stage not in calibrated_stages and stage not in _MULTIPLIED_STAGES
    )


class CostCorrections:
    """Corrections of one scene: a factor a renderer, added times a camera and renderer."""

    def __init__(self) -> None:
        """Create corrections without any frame."""
        self._factors: dict[RendererKind, float] = {}
        self._added_ms: dict[_EffectsKey, dict[RendererKind, float]] = {}

    def factor(self, kind: RendererKind) -> float:
        """Factor by which a renderer's frames take longer than calibrated ones."""
        return self._factors.get(kind, 1.0)

    def correct(self, camera: OmniCameraSpec, kind: RendererKind, ms: float) -> float:
        """Milliseconds of a drawn frame, from those of the cost model."""
        return self.factor(kind) * ms + self._find_added_ms(camera, kind)

    def update(
        self,
        camera: OmniCameraSpec,
        kind: RendererKind,
        model_ms: float,
        *,
        median_ms: float,
        added_ms: float,
    ) -> None:
        """Update the corrections by medians of drawn frames.

        Args:
            camera: Camera of the frames.
            kind: Renderer of the frames.
            model_ms: Milliseconds of the cost model, uncorrected: a correction must not feed on
                itself.
            median_ms: Median time of the frames.
            added_ms: Median time of their stages without calibration.
        """
        factor = (median_ms - added_ms) / model_ms
        self._factors[kind] = min(max(factor, 1.0 / _MAX_FACTOR), _MAX_FACTOR)
        self._added_ms.setdefault(_effects_key(camera), {})[kind] = added_ms

    def _find_added_ms(self, camera: OmniCameraSpec, kind: RendererKind) -> float:
        """Added time by a renderer; until it has drawn, by another one; 0 before any frame."""
        known = self._added_ms.get(_effects_key(camera), {})
        return known.get(kind, next(iter(known.values()), 0.0))

    def clear(self) -> None:
        """Forget the added times: cameras are planned anew."""
        self._added_ms.clear()


def _effects_key(camera: OmniCameraSpec) -> _EffectsKey:
    """Everything of a camera that added times depend on."""
    return camera.camera, camera.effect_settings
