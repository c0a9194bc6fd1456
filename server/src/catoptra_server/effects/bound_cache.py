"""Cache of an effect's bounds, keyed by the summary fields that the effect declares to read.

Most frames of a driving robot have a new summary, but only a speed or a distance differs: a bound
that depends on neither is the same. A bound is a pure function of the declared fields and the
camera; a test compares the declaration with the fields that each criterion reads.
"""

from __future__ import annotations

from catoptra_protocol.optics.radial_camera import RadialCamera
from catoptra_server.effects.effect import Effect, EffectBound
from catoptra_server.effects.scene_summary import SceneSummary

# Summaries are rounded to cells, so a drive through a world has some hundreds of them.
_MAX_ENTRIES = 512


class BoundCache:
    """Bounds of one effect in the images of one camera."""

    def __init__(self, effect: Effect, camera: RadialCamera) -> None:
        self._effect = effect
        self._camera = camera
        self._field_names = tuple(effect.reads)
        self._bounds: dict[tuple[object, ...], EffectBound] = {}

    def get(self, summary: SceneSummary) -> EffectBound:
        """Return the effect's bound, computed only for values not met before."""
        key = tuple(getattr(summary, name) for name in self._field_names)
        bound = self._bounds.get(key)
        if bound is None:
            # First in, first out: a robot leaves cells behind, so the oldest entry is the one
            # least likely to return.
            while len(self._bounds) >= _MAX_ENTRIES:
                self._bounds.pop(next(iter(self._bounds)))
            bound = self._bounds[key] = self._effect.bound(summary, self._camera)
        return bound
