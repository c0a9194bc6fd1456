"""Ground truth of frames: rays of their cameras, prepared once, and what these meet.

Belongs to the thread of the renderers. The rays of a camera are kept as long as there is room.
"""

from __future__ import annotations

from collections.abc import Collection
from functools import cached_property

import numpy as np
import numpy.typing as npt

from catoptra_protocol.labels.channels import LABEL_CHANNELS, GroundTruth, parse_channels
from catoptra_server.ground_truth.flow import find_flow
from catoptra_server.ground_truth.label_rays import (
    DrawnExposure,
    RaySource,
    build_label_rays,
    label_exposure,
    mask_of_rays,
)
from catoptra_server.ground_truth.occluded_fraction import OcclusionMeter, PixelRayGrid
from catoptra_server.ground_truth.scene_labels import SceneLabels
from catoptra_server.render.trace import TraceRenderer
from catoptra_server.render.trace.kernel.library import AUTO
from catoptra_server.render.trace.ray_table import RayTable
from catoptra_server.render.trace.trace_engine import (
    LabelRequest,
    LabelTables,
    PixelLabels,
    TracedRays,
)
from catoptra_server.world.camera_state import CameraState
from catoptra_server.world.scene_mesh import SceneMesh

# Rays of labels beside those of pictures: 13 bytes a sample, so that two cameras of 2048 px stay.
_MAX_RAY_BYTES = 256 * 2**20


class _PreparedRays:
    """Rays of an image, and what labels derive from them once."""

    def __init__(self, table: RayTable, renderer: TraceRenderer) -> None:
        self.table = table
        self._renderer = renderer
        self._rays: TracedRays | None = None

    @property
    def rays(self) -> TracedRays:
        """The same rays, ready to be traced by themselves: not needed beside a picture."""
        if self._rays is None:
            self._rays = self._renderer.prepare_rays(self.table)
        return self._rays

    @property
    def memory_bytes(self) -> int:
        """Size of the rays, and of what the engine needs for them."""
        return (self._rays or self.table).memory_bytes

    def close(self) -> None:
        """Free what belongs to the rays."""
        if self._rays is not None:
            self._rays.close()

    @cached_property
    def mask(self) -> npt.NDArray[np.uint8]:
        """(h, w) 1 where a pixel's centre has a ray, else 0."""
        return mask_of_rays(self.table).astype(np.uint8)

    @cached_property
    def grid(self) -> PixelRayGrid:
        """The same rays in rows, for occluded fractions."""
        return PixelRayGrid(self.table)


class LabelRenderer:
    """Ground truth in one scene."""

    def __init__(
        self, renderer: TraceRenderer, scene: SceneMesh, instruction_set: str = AUTO
    ) -> None:
        """Number the scene's objects.

        Args:
            renderer: Traces the rays; closed by its owner.
            scene: The same scene.
            instruction_set: Of the rays that measure occlusion; "auto" for the processor's best.

        Raises:
            DomainError: The world has more objects than labels number.
        """
        self._renderer = renderer
        self.labels = SceneLabels(scene)
        """Numbers of objects and classes."""
        self._meter = OcclusionMeter(scene, self.labels, instruction_set)
        self._prepared: dict[tuple[RaySource, int], _PreparedRays] = {}  # last used at the end

    def render(
        self,
        drawn: DrawnExposure,
        channels: Collection[str],
        other: CameraState | None = None,
        found_beside: PixelLabels | None = None,
    ) -> GroundTruth:
        """Ground truth of an exposure.

        Args:
            drawn: The exposure.
            channels: Names of the channels that are wanted.
            other: State of the frame that `flow` leads to, with the objects of that frame; None:
                there is no such frame, and the flow is unknown.
            found_beside: Labels of `request` for the same exposure and channels, found while its
                picture was drawn; None: they are traced now.

        Raises:
            DomainError: There is no channel of a name.
        """
        wanted = {channel.name for channel in parse_channels(tuple(channels))}
        found = self._trace(drawn, wanted) if found_beside is None else dict(found_beside)
        if "flow" in wanted:
            found |= self._find_flow(drawn, found, other)
        if "valid" in wanted:
            found["valid"] = self._prepare(drawn.ray_source, 1).mask.copy()
        objects = self.labels.describe(drawn.camera_state.objects)
        return GroundTruth(
            {name: found[name] for name in LABEL_CHANNELS if name in wanted}, objects
        )

    def request(self, drawn: DrawnExposure, channels: Collection[str]) -> LabelRequest | None:
        """Labels that the rays of a picture find while it is drawn, for a part of the time.

        Args:
            drawn: The exposure, of which no picture is drawn yet.
            channels: Names of the channels that are wanted.

        Returns:
            The request; None where labels are of other rays or times than the picture.

        Raises:
            DomainError: There is no channel of a name.
        """
        is_of_same_rays = drawn.ray_source == RaySource(drawn.camera)
        wanted = {channel.name for channel in parse_channels(tuple(channels))}
        if not is_of_same_rays or drawn.camera_state.shutter is not None or wanted <= {"valid"}:
            return None
        return self._make_request(drawn, wanted)

    def _make_request(self, drawn: DrawnExposure, wanted: set[str]) -> LabelRequest:
        # Flow begins at the points of the objects that pixels show.
        needed = wanted | ({"ids", "point"} if "flow" in wanted else set())
        centres = self._prepare(drawn.ray_source, 1).table
        return LabelRequest(frozenset(needed), self._tables(drawn.camera_state), centres)

    def _trace(self, drawn: DrawnExposure, wanted: set[str]) -> PixelLabels:
        """Labels without a picture."""
        request = self._make_request(drawn, wanted)
        # Only agreement takes more rays than those of the pixels' centres.
        samples = drawn.samples if "agreement" in wanted else 1
        rays = self._prepare(drawn.ray_source, samples).rays
        return rays.label_pixels(label_exposure(drawn.camera_state), request)

    def measure_occlusion(self, drawn: DrawnExposure, truth: GroundTruth) -> dict[int, float]:
        """Hidden fraction of each object in view, by number; of ground truth with `ids`."""
        prepared = self._prepare(drawn.ray_source, 1)
        ids = truth.channels["ids"]
        return self._meter.measure(truth.objects, ids, prepared.grid, drawn.camera_state)

    def _tables(self, camera_state: CameraState) -> LabelTables:
        """Numbers of the objects of an exposure."""
        numbers = [self.labels.number_of(placed) for placed in camera_state.objects]
        return LabelTables(
            self.labels.triangle_numbers,
            np.array(numbers, dtype=np.uint16),
            self.labels.class_table,
        )

    def _find_flow(
        self, drawn: DrawnExposure, found: PixelLabels, other: CameraState | None
    ) -> PixelLabels:
        if other is None:
            height_px, width_px = drawn.camera.height_px, drawn.camera.width_px
            unknown = np.full((height_px, width_px, 2), np.nan, dtype=np.float32)
            return {"flow": unknown}
        motions = {
            self.labels.number_of(there): there.world_from_object @ here.world_from_object.inverse()
            for here in drawn.camera_state.objects
            for there in other.objects
            if self.labels.number_of(here) == self.labels.number_of(there)
        }
        gone = {self.labels.number_of(here) for here in drawn.camera_state.objects} - set(motions)
        flow = find_flow(
            self._renderer,
            self._prepare(drawn.ray_source, 1).rays,
            drawn.ray_source,
            other,
            found["point"],
            found["ids"],
            motions,
            gone,
        )
        return {"flow": flow}

    def _prepare(self, source: RaySource, samples: int) -> _PreparedRays:
        """Rays of an image, prepared at the first use."""
        key = source, samples
        prepared = self._prepared.pop(key, None)
        if prepared is None:
            prepared = _PreparedRays(build_label_rays(source, samples), self._renderer)
        self._prepared[key] = prepared
        while len(self._prepared) > 2 and self._memory_bytes > _MAX_RAY_BYTES:
            self._prepared.pop(next(iter(self._prepared))).close()
        return prepared

    @property
    def _memory_bytes(self) -> int:
        return sum(prepared.memory_bytes for prepared in self._prepared.values())

    def close(self) -> None:
        """Free all rays."""
        while self._prepared:
            self._prepared.popitem()[1].close()
