"""Memory that cameras, meshes and textures would take, compared with a limit before it is taken.

Files can announce more than they contain: a PNG of 22 kB has 13 300 px a side, a camera of 16 x 16
samples a pixel needs 256 rays for each. Sizes are estimated from such numbers alone. The estimates
are peaks of the resident size, start included, in tests/measurements/memory_per_item.py.
"""

from __future__ import annotations

import math

from catoptra_protocol.errors import ConfigError, SourceLocation
from catoptra_protocol.slotted_dataclass import dataclass

MIB = 2**20
# A camera of 2048 px at 2 x 2 samples, or a world of 1.3 million triangles, fits.
DEFAULT_LIMIT_BYTES = 1024 * MIB
# A tebibyte: a larger number is taken for bytes.
MAX_LIMIT_MIB = 2**20

# A triangle in NumPy arrays and in the structures of raster, which takes more than trace: 590, with
# colours at its corners 670; texture coordinates add 60.
BYTES_PER_TRIANGLE = 750
# Three bytes, three linear float32 and four numbers of the trace renderer with a third more for the
# coarser levels, and four more bytes while Pillow decodes.
BYTES_PER_TEXEL = 36

# Rays of a sample in two orders, 12 bytes each, and the batch in which these are computed.
_TRACE_BYTES_PER_SAMPLE = 26
# Of a mirror without a viewpoint a ray has an origin, too: 39 bytes a sample instead of 19.
_ORIGIN_BYTES_PER_SAMPLE = 20
_TRACE_BYTES_PER_PX = 40
_TRACE_BYTES = 64 * MIB
# Lookup map of a sample: 8 bytes on the device, as many on the way there.
_RASTER_BYTES_PER_SAMPLE = 18
_RASTER_BYTES_PER_PX = 20
_RASTER_BYTES = 48 * MIB
# Linear light and depth, of each sample of a texel, and of the texel after they are averaged.
_RASTER_BYTES_PER_TEXEL = 12
# All effects of p2at_omni_real.ini at once: 440 in trace, 490 in raster.
_EFFECT_BYTES_PER_PX = 500


@dataclass(frozen=True, slots=True)
class ViewSize:
    """Numbers that determine the memory of one camera's view."""

    num_pixels: int
    samples_per_pixel: int
    num_texels: int = 0
    """Texels of all faces in the raster renderer."""
    samples_per_texel: int = 1
    has_effects: bool = False
    """Whether effects may change the image."""
    has_origins: bool = False
    """Whether each ray has an origin of its own."""

    @property
    def num_bytes(self) -> int:
        """Bytes with the renderer that takes more, since either may be chosen."""
        samples = self.num_pixels * self.samples_per_pixel
        origins = _ORIGIN_BYTES_PER_SAMPLE if self.has_origins else 0
        trace = _TRACE_BYTES + (_TRACE_BYTES_PER_SAMPLE + origins) * samples
        trace += _TRACE_BYTES_PER_PX * self.num_pixels
        raster = _RASTER_BYTES + _RASTER_BYTES_PER_SAMPLE * samples
        raster += _RASTER_BYTES_PER_PX * self.num_pixels
        raster += _RASTER_BYTES_PER_TEXEL * self.num_texels * (1 + self.samples_per_texel)
        effects = _EFFECT_BYTES_PER_PX * self.num_pixels if self.has_effects else 0
        return max(trace, raster) + effects


class MemoryBudget:
    """Memory of one camera's view, or of one world's triangles and textures together."""

    def __init__(self, limit_bytes: int = DEFAULT_LIMIT_BYTES) -> None:
        self._limit_bytes = limit_bytes
        self._reserved_bytes = 0

    def for_reading(self) -> MemoryBudget:
        """Budget of the same limit, for memory that is free again once a file is read."""
        return MemoryBudget(self._limit_bytes)

    def reserve(
        self, num_bytes: int, *, where: SourceLocation, key: str, value: str, remedy: str
    ) -> None:
        """Count memory that is about to be taken.

        Args:
            num_bytes: the estimate.
            where: file and line of the number that the estimate follows from.
            key: the number's key.
            value: the number.
            remedy: acceptable value, as a phrase, such as `a smaller texture`.

        Raises:
            ConfigError: if the limit is exceeded.
        """
        self._reserved_bytes += num_bytes
        if self._reserved_bytes > self._limit_bytes:
            total = _format_mib(self._reserved_bytes)
            limit = _format_mib(self._limit_bytes)
            expected = (
                f"{remedy}: this would take {total} MiB of memory, more than the limit of {limit} "
                "(--memory-limit-mib)"
            )
            raise ConfigError(where, key=key, value=value, expected=expected)


def _format_mib(num_bytes: int) -> str:
    return str(math.ceil(num_bytes / MIB))
