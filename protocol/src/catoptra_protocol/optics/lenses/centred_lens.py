"""What all lens models share: the image's centre shows the axis, and most never turn back."""

from __future__ import annotations

from catoptra_protocol.optics.radial_projection import NO_FOLD


class CentredLens:
    """Base of the lenses."""

    __slots__ = ()

    @property
    def t_min(self) -> float:
        """0: the image's centre shows the axis."""
        return 0.0

    @property
    def fold_rad(self) -> float:
        """Infinity: the image radius grows up to the limit."""
        return NO_FOLD
