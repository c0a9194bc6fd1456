"""Rows of docs/PROOF.md: what was compared with what, how far apart they are, and by which bound.

A model whose parameter is changed by 1e-4 must exceed its bound somewhere: `mutants` has them.
"""

from __future__ import annotations

import importlib
import importlib.metadata
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.numerics import Floats
from catoptra_protocol.optics.omni_camera import OmniCamera

MUTATION = 1e-4
# Program of a formula that the measurement has itself, from the publication named beside it.
TRANSCRIBED = "transcribed formula"


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
    subject: str,
    authority: str,
    differences: Floats,
    bound: float,
    unit: str,
    *,
    error: str = "",
    note: str = "",
) -> Finding:
    """Finding of (n,) absolute differences."""
    if len(differences) == 0:
        raise ValueError(f"{subject}, {authority}: nothing was compared")
    largest, median = float(np.max(differences)), float(np.median(differences))
    return Finding(subject, authority, largest, median, bound, unit, len(differences), error, note)


def version_of(package: str) -> str:
    """Name and version of an installed package."""
    return f"{package} {importlib.metadata.version(package)}"


def is_installed(module: str) -> bool:
    """Whether a foreign program can be imported."""
    try:
        importlib.import_module(module)
    except ImportError:
        return False
    return True


def mutants(camera: OmniCamera) -> Iterator[tuple[str, OmniCamera]]:
    """Cameras with one number of the model, or the scale, changed by 1e-4 of itself.

    A rim is no number of the model: it says where the image ends.
    """
    yield "scale", replace(camera, scale_px=camera.scale_px * (1.0 + MUTATION))
    for part in ("projection", "plane"):
        model: Any = getattr(camera, part)
        for each in fields(model):
            if each.name == "rim_rad":
                continue
            for name, value in _changed(each.name, getattr(model, each.name)):
                # A table that the model itself rejects is noticed before it is drawn.
                with suppress(DomainError):
                    yield name, replace(camera, **{part: replace(model, **{each.name: value})})


def _changed(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    numbers = value if isinstance(value, tuple) else (value,)
    for index, number in enumerate(numbers):
        if number != 0.0:
            changed = (*numbers[:index], number * (1.0 + MUTATION), *numbers[index + 1 :])
            if isinstance(value, tuple):
                yield f"{name}[{index}]", changed
            else:
                yield name, changed[0]
