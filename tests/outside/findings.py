"""Rows of docs/PROOF.md: what was compared with what, how far apart they are, and by which bound.

A model whose parameter is changed by 1e-4 must exceed its bound somewhere: `mutants` has them.
"""

from __future__ import annotations

import importlib.metadata
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera

MUTATION = 1e-4


@dataclass(frozen=True, slots=True)
class Finding:
    """One comparison."""

    subject: str
    """Model, or what was drawn."""
    authority: str
    """Program with its version, or the publication of a formula."""
    largest: float
    median: float
    bound: float
    unit: str
    count: int
    error: str = ""
    """Standard errors, where there is noise."""
    note: str = ""

    @property
    def holds(self) -> bool:
        """Whether the largest difference is within the bound; NaN is not."""
        return self.largest <= self.bound


def summarize(
    subject: str, authority: str, differences: Floats, bound: float, unit: str,
    *, error: str = "", note: str = "",
) -> Finding:  # fmt: skip
    """Finding of (n,) absolute differences."""
    if len(differences) == 0:
        raise ValueError(f"{subject}, {authority}: nothing was compared")
    largest, median = float(np.max(differences)), float(np.median(differences))
    return Finding(subject, authority, largest, median, bound, unit, len(differences), error, note)


def bisect(value: Callable[[Floats], Floats], target: Floats, high: float) -> Floats:
    """Arguments in 0 to `high` at which an increasing function has (n,) values, to a last digit."""
    low, upper = np.zeros_like(target), np.full_like(target, high)
    for _ in range(64):
        middle = 0.5 * (low + upper)
        below = value(middle) < target
        low, upper = np.where(below, middle, low), np.where(below, upper, middle)
    return 0.5 * (low + upper)


def version_of(package: str) -> str:
    """Name and version of an installed package."""
    return f"{package} {importlib.metadata.version(package)}"


def mutants(camera: OmniCamera) -> Iterator[tuple[str, OmniCamera]]:
    """Cameras with the scale, first, or one number of the model changed by 1e-4 of itself.

    A rim is no number of the model: it says where the image ends.
    """
    yield "scale", replace(camera, scale_px=camera.scale_px * (1.0 + MUTATION))
    for part in ("projection", "plane"):
        model: Any = getattr(camera, part)
        for each in (each.name for each in fields(model) if each.name != "rim_rad"):
            for name, value in _changed(each, getattr(model, each)):
                # A table that the model itself rejects is noticed before it is drawn.
                with suppress(DomainError):
                    yield name, replace(camera, **{part: replace(model, **{each: value})})


def _changed(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    if not isinstance(value, tuple):
        if value != 0.0:
            yield name, value * (1.0 + MUTATION)
        return
    for index, number in enumerate(value):
        for place, changed in _changed(f"{name}[{index}]", number):
            yield place, (*value[:index], changed, *value[index + 1 :])
