"""Passes in order: to a finished image, or to an exposure that is read back before its effects."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import numpy.typing as npt

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.effect import ImageEffect
from catoptra_server.render.raster.effect_chain import EffectChain
from catoptra_server.render.raster.face_pass import FacePass
from catoptra_server.render.raster.linear_image_target import LinearImageTarget
from catoptra_server.render.raster.passes import Pass
from catoptra_server.render.raster.range_pass import RangePass
from catoptra_server.render.renderer import LinearImage


@dataclass(frozen=True, slots=True, eq=False)
class ExposureTarget:
    """What an image changer needs of an exposure, on the device."""

    image: LinearImageTarget
    """Linear light before all image effects."""
    ranges: RangePass | None
    """Ranges of the pixels, None where no effect uses them."""

    def read(self) -> tuple[LinearImage, npt.NDArray[np.float32] | None]:
        """Read back (h, w, 3) light and (h, w) ranges, metres."""
        return self.image.read(), self.ranges.read() if self.ranges else None


@dataclass(frozen=True, slots=True, eq=False)
class PassSequence:
    """The passes from the faces to an image; the faces are freed with their view."""

    passes: tuple[Pass, ...]
    """Passes in order of rendering."""
    effect_chain: EffectChain | None = None
    """Effects and encoding, None where the pass before encodes by itself."""
    exposure: ExposureTarget | None = None
    """Image that is read back, None where the passes finish it."""

    @property
    def memory_bytes(self) -> int:
        """Size of the images of passes and effects, without the faces."""
        passes = (one for one in self.passes if not isinstance(one, FacePass))
        chain = self.effect_chain.memory_bytes if self.effect_chain else 0
        exposure = self.exposure.image.memory_bytes if self.exposure else 0
        return sum(one.memory_bytes for one in passes) + chain + exposure

    def close(self) -> None:
        """Free the passes, and the images between them."""
        for render_pass in reversed(self.passes):
            if not isinstance(render_pass, FacePass):
                render_pass.close()
        if self.effect_chain is not None:
            self.effect_chain.close()
        if self.exposure is not None:
            self.exposure.image.close()


class SequenceFactory(Protocol):
    """Builds the sequences of one view; a sequence is freed with its resources."""

    def make_plain(self) -> PassSequence:
        """Sequence to the finished image without linear light."""

    def make_linear(self, effects: tuple[ImageEffect, ...], has_shutter: bool) -> PassSequence:
        """Sequence of effects, or of a long exposure, to the finished image."""

    def make_exposure(self, *, has_ranges: bool, has_shutter: bool) -> PassSequence:
        """Sequence to an exposure that is read back, with ranges or without."""
