"""Bounds that were found before, kept by what of a summary they were found from.

A robot that drives has another summary every few frames, but what is new in it is a speed, or a
distance: a bound that asked for neither is what it was. What each asks for is seen when it asks; a
bound is a pure function, so one that is told the same again asks for the same, and ends the same.
"""

from __future__ import annotations

from typing import cast

from catoptra_protocol.optics.camera import OmniCamera
from catoptra_server.effects.effect import Bound, Criterion
from catoptra_server.effects.scene_summary import SceneSummary

# A robot's way through a world has some hundreds; what was found first is forgotten first.
_KEPT = 512

_Names = tuple[str, ...]


class KeptBounds:
    """The bounds of one effect in the pictures of one camera."""

    def __init__(self, effect: Criterion, camera: OmniCamera) -> None:
        self._effect = effect
        self._camera = camera
        self._found: dict[tuple[_Names, tuple[object, ...]], Bound] = {}
        self._asked_for: list[_Names] = []

    def of(self, summary: SceneSummary) -> Bound:
        """Return the effect's bound."""
        for names in self._asked_for:
            known = self._found.get((names, _values(summary, names)))
            if known is not None:
                return known
        return self._find(summary)

    def _find(self, summary: SceneSummary) -> Bound:
        asked = _Asked(summary)
        bound = self._effect.bound(cast(SceneSummary, asked), self._camera)
        names = tuple(asked.names)
        if names not in self._asked_for:
            self._asked_for.append(names)
        while len(self._found) >= _KEPT:
            self._found.pop(next(iter(self._found)))
        self._found[names, _values(summary, names)] = bound
        return bound


class _Asked:
    """A summary that takes note of which of its fields are read; it cannot be copied."""

    def __init__(self, summary: SceneSummary) -> None:
        self._summary = summary
        self.names: dict[str, None] = {}

    def __getattr__(self, name: str) -> object:
        self.names[name] = None
        return getattr(self._summary, name)


def _values(summary: SceneSummary, names: _Names) -> tuple[object, ...]:
    return tuple(getattr(summary, name) for name in names)
