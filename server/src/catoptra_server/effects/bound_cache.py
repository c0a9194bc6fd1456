"""Bounds that were found before, kept by what of a summary they were found from.

A robot that drives has another summary every few frames, but what is new in it is a speed, or a
distance: a bound that asked for neither is what it was. What each asks for is seen when it asks; a
bound is a pure function, so one that is told the same again asks for the same, and ends the same.
"""

from __future__ import annotations

from typing import cast

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.effects.effect import Effect, EffectBound
from catoptra_server.effects.scene_summary import SceneSummary

# A robot's way through a world has some hundreds; what was found first is forgotten first.
_MAX_ENTRIES = 512

_FieldNames = tuple[str, ...]


class BoundCache:
    """The bounds of one effect in the pictures of one camera."""

    def __init__(self, effect: Effect, camera: OmniCamera) -> None:
        self._effect = effect
        self._camera = camera
        self._bounds: dict[tuple[_FieldNames, tuple[object, ...]], EffectBound] = {}
        self._accessed_fields: list[_FieldNames] = []

    def get(self, summary: SceneSummary) -> EffectBound:
        """Return the effect's bound."""
        for names in self._accessed_fields:
            known = self._bounds.get((names, _field_values(summary, names)))
            if known is not None:
                return known
        return self._compute(summary)

    def _compute(self, summary: SceneSummary) -> EffectBound:
        asked = _FieldAccessRecorder(summary)
        bound = self._effect.bound(cast(SceneSummary, asked), self._camera)
        names = tuple(asked.field_names)
        if names not in self._accessed_fields:
            self._accessed_fields.append(names)
        while len(self._bounds) >= _MAX_ENTRIES:
            self._bounds.pop(next(iter(self._bounds)))
        self._bounds[names, _field_values(summary, names)] = bound
        return bound


class _FieldAccessRecorder:
    """A summary that takes note of which of its fields are read; it cannot be copied."""

    def __init__(self, summary: SceneSummary) -> None:
        self._summary = summary
        self.field_names: dict[str, None] = {}

    def __getattr__(self, name: str) -> object:
        self.field_names[name] = None
        return getattr(self._summary, name)


def _field_values(summary: SceneSummary, names: _FieldNames) -> tuple[object, ...]:
    return tuple(getattr(summary, name) for name in names)
