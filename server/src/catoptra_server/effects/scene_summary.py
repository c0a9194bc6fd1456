"""What criteria know of a scene before it is drawn. Every number is a bound, none an estimate."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class SceneSummary:
    """What can reach a pixel at most.

    largest_radiance: of any colour; 1 = what fills a pixel's well. The least is 0: beside the
    mirror every picture is black.
    """

    largest_radiance: float
