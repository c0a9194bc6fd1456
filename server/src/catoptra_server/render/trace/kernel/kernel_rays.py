"""The rays of one camera on a kernel device: frames, hits, labels and flow."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from catoptra_protocol.errors import DomainError
from catoptra_server.render.renderer import NO_THRESHOLDS, Image, LinearImage
from catoptra_server.render.trace.flow_tables import FlowTables
from catoptra_server.render.trace.kernel.exposure_arrays import ray_table_struct
from catoptra_server.render.trace.kernel.flow_arrays import flow_arrays
from catoptra_server.render.trace.kernel.kernel_library import KernelDevice, KernelError
from catoptra_server.render.trace.kernel.kernel_structs import (
    OUTPUT_FLOW,
    OUTPUT_HITS,
    OUTPUT_LABELS,
    OUTPUT_LINEAR,
    OUTPUT_SRGB,
    FrameCounts,
)
from catoptra_server.render.trace.kernel.label_arrays import (
    CentreMatch,
    label_arrays,
    match_centres,
)
from catoptra_server.render.trace.kernel.scene_arrays import Owned
from catoptra_server.render.trace.label_tables import LabelRequest
from catoptra_server.render.trace.ray_table import BLOCK_RAYS, Float32s, RayTable
from catoptra_server.render.trace.trace_engine import (
    ANY_CHANGE,
    PixelLabels,
    RayHits,
    TracedExposure,
    TracedFrame,
    TraceRequest,
    find_ego_body,
    first_state,
    invert_ranges,
)

if TYPE_CHECKING:
    from catoptra_server.render.trace.kernel.kernel_engine import KernelEngine


class KernelRays:
    """The rays of one camera on a kernel device."""

    def __init__(self, table: RayTable, device: KernelDevice, engine: KernelEngine) -> None:
        """Prepare the rays; the kernel reads the table's own arrays."""
        self._table = table
        self._device = device
        self._engine = engine
        self._view: int | None = device.prepare(ray_table_struct(table))
        self._centres: CentreMatch | None = None
        self.last_counts = FrameCounts()
        """Tiles of the last frame: all, and those that one surface was proven to fill."""

    @property
    def memory_bytes(self) -> int:
        """Size of the rays and of the beams around them."""
        own = 0 if self._view is None else self._device.view_bytes(self._view)
        return self._table.memory_bytes + own

    def render(self, exposure: TracedExposure, request: TraceRequest) -> TracedFrame:
        """A frame and all other outputs that are wanted."""
        output = OUTPUT_LINEAR if request.is_linear else OUTPUT_SRGB
        shape = (self._table.height_px, self._table.width_px)
        image: npt.NDArray[Any] = np.zeros(
            (*shape, 3), dtype=np.float32 if request.is_linear else np.uint8
        )
        inverse = np.zeros(shape, dtype=np.float32) if request.has_ranges else None
        labels, owned = self._label_beside(request.labels)
        self._render(
            exposure,
            output,
            image,
            thresholds=request.thresholds,
            inverse_range=inverse,
            labels=owned,
        )
        # Frames are handed to other threads, which encode them while the next one is rendered.
        if not request.is_linear:
            image.setflags(write=False)
        counts, shutter = self.last_counts, first_state(exposure).shutter
        is_blurred = shutter is not None and shutter.exposure_s > 0.0
        return TracedFrame(
            image,
            _read_changes(exposure, counts, request.thresholds),
            None if inverse is None else invert_ranges(inverse),
            {"MotionBlur": counts.blur_ms} if is_blurred else {},
            labels,
        )

    def render_srgb(self, exposure: TracedExposure) -> Image:
        """(h, w, 3) sRGB, read-only; black off the mirror. Samples are clipped to [0, 1]."""
        return self.render(exposure, TraceRequest()).image

    def render_linear(self, exposure: TracedExposure) -> LinearImage:
        """(h, w, 3) linear light; zero off the mirror. Light beyond white is kept."""
        return self.render(exposure, TraceRequest(is_linear=True)).image

    def find_hits(self, exposure: TracedExposure) -> RayHits:
        """First hit of each ray."""
        shape = (*self._table.valid.shape, BLOCK_RAYS)
        range_m = np.zeros(shape, dtype=np.float32)
        triangle, hit_object = np.zeros(shape, dtype=np.int32), np.zeros(shape, dtype=np.int32)
        self._render(exposure, OUTPUT_HITS, range_m, triangle, hit_object)
        return RayHits(range_m, triangle, hit_object)

    def label_pixels(self, exposure: TracedExposure, request: LabelRequest) -> PixelLabels:
        """Labels without an image; their agreement is that of these rays."""
        arrays, owned = label_arrays(self._match(request.centres), request)
        self._engine.render(self._require_view(), exposure, OUTPUT_LABELS, labels=owned)
        return arrays

    def _label_beside(
        self, request: LabelRequest | None
    ) -> tuple[PixelLabels | None, Owned | None]:
        """Channels to be found beside a picture; without any where these rays cannot find them."""
        if request is None:
            return None, None
        try:
            return label_arrays(self._match(request.centres), request)
        except DomainError:
            # The picture is as good without; whoever wants the labels alone is told why.
            return None, None

    def _match(self, centres: RayTable) -> CentreMatch:
        """Where the rays of the pixels' centres are among these; kept for the next frame."""
        if self._centres is None or self._centres.centres is not centres:
            view = self._require_view()
            self._centres = match_centres(self._device, view, self._table, centres)
        return self._centres

    def find_flow(self, other: TracedExposure, tables: FlowTables) -> Float32s:
        """(h, w, 2) displacement of points to their places in another exposure; nan: not seen."""
        flow, owned = flow_arrays(tables, self._engine.centre)
        self._engine.render(self._require_view(), other, OUTPUT_FLOW, flow=owned)
        return flow

    def trace_bare(self, exposure: TracedExposure) -> None:
        """Trace the rays without any use of the hits: the bare packet rate, for benchmarks."""
        self._engine.trace_bare(self._require_view(), exposure)

    def _render(
        self,
        exposure: TracedExposure,
        output: int,
        *arrays: npt.NDArray[np.generic],
        thresholds: Mapping[str, float] = NO_THRESHOLDS,
        inverse_range: Float32s | None = None,
        labels: Owned | None = None,
    ) -> None:
        self.last_counts = self._engine.render(
            self._require_view(),
            exposure,
            output,
            *arrays,
            thresholds=thresholds,
            inverse_range=inverse_range,
            labels=labels,
        )

    def _require_view(self) -> int:
        if self._view is None:
            raise KernelError("the view is closed: nothing can be rendered with it")
        return self._view

    def close(self) -> None:
        """Free the view."""
        if self._view is not None:
            self._device.release_view(self._view)
        self._view = self._centres = None


def _read_changes(
    exposure: TracedExposure, counts: FrameCounts, thresholds: Mapping[str, float]
) -> dict[str, float]:
    """Largest changes by the scene's effects that are drawn and have a threshold."""
    state = first_state(exposure)
    changes = {}
    if state.has_shadows:
        changes["Shadows"] = counts.shadow_change
    if state.fog is not None:
        changes["Fog"] = counts.fog_change
    if find_ego_body(exposure):
        changes["SelfView"] = ANY_CHANGE if counts.shows_watched else 0.0
    if state.shutter is not None and state.shutter.readout_s > 0.0:
        changes["RollingShutter"] = counts.rolling_change
    if state.shutter is not None and state.shutter.exposure_s > 0.0:
        changes["MotionBlur"] = counts.blur_change
    return {name: change for name, change in changes.items() if name in thresholds}
