"""Passes in order: to a finished image, or to an exposure that is read back before its effects."""

from __future__ import annotations

from typing import Protocol

import moderngl
import numpy as np
import numpy.typing as npt

from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.raster.face_pass import FacePass
from catoptra_server.render.raster.linear_image_target import LinearImageTarget
from catoptra_server.render.raster.passes import AveragePass, Pass
from catoptra_server.render.raster.range_pass import RangePass
from catoptra_server.render.raster.shader_programs import ShaderPrograms
from catoptra_server.render.renderer import LinearImage


@dataclass(frozen=True, slots=True, eq=False)
class ExposureTarget:
    """An exposure in linear light, on the device."""

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
    exposure: ExposureTarget | None = None
    """Linear light; None where the only pass behind the faces encodes by itself."""

    def append_encoding(
        self, context: moderngl.Context, programs: ShaderPrograms, target: moderngl.Framebuffer
    ) -> PassSequence:
        """Same sequence of an exposure, with a last pass that encodes the image into a target."""
        assert self.exposure is not None, "the last pass encodes already"
        image = self.exposure.image.texture
        encode = AveragePass(context, programs, image, 1, target, name="encode")
        return PassSequence((*self.passes, encode), self.exposure)

    @property
    def memory_bytes(self) -> int:
        """Size of the images of all passes, without the faces."""
        passes = (one for one in self.passes if not isinstance(one, FacePass))
        exposure = self.exposure.image.memory_bytes if self.exposure else 0
        return sum(one.memory_bytes for one in passes) + exposure

    def close(self) -> None:
        """Free the passes, and the images between them."""
        for render_pass in reversed(self.passes):
            if not isinstance(render_pass, FacePass):
                render_pass.close()
        if self.exposure is not None:
            self.exposure.image.close()


class SequenceFactory(Protocol):
    """Builds the sequences of one view; a sequence is freed with its resources."""

    def make_plain(self) -> PassSequence:
        """Sequence to the finished image without linear light."""

    def make_long_exposure(self) -> PassSequence:
        """Sequence of a long exposure to the finished image."""

    def make_exposure(self, *, has_ranges: bool, has_shutter: bool) -> PassSequence:
        """Sequence to an exposure that is read back, with ranges or without."""
