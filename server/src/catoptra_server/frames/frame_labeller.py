"""Labels of frames: the rays that a frame's picture was drawn by, and where they lead to.

Belongs to the thread of the renderers. Nothing exists before the first request for a channel.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from catoptra_protocol.errors import DomainError, RendererUnavailableError
from catoptra_protocol.labels.channels import LABEL_CHANNELS, count_bytes
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.effects.bounds.scene_summarizer import SceneSummarizer
from catoptra_server.effects.medium.misalignment import Misalignment
from catoptra_server.frames.frame_labels import FrameLabels
from catoptra_server.frames.frame_request import Channel
from catoptra_server.frames.renderer_recovery import ViewFailedError
from catoptra_server.ground_truth.label_rays import DrawnExposure
from catoptra_server.planning.renderer_pool import RendererPool
from catoptra_server.runtime.memory import LruDict
from catoptra_server.world.camera_state import CameraState

if TYPE_CHECKING:
    from catoptra_server.ground_truth.label_renderer import LabelRenderer
    from catoptra_server.render.trace.trace_engine import LabelRequest, PixelLabels

# All channels of one frame: what a client accepts of an image. Frames wait one a client.
MAX_CHANNEL_BYTES = 64 * 2**20
# Channels whose last frame a flow may lead to.
_MAX_LAST_STATES = 64


@dataclass(frozen=True, slots=True, eq=False)
class _LastExposure:
    time_s: float
    camera_state: CameraState


class FrameLabeller:
    """Labels of the frames of one scene."""

    def __init__(self, renderers: RendererPool, summarizer: SceneSummarizer) -> None:
        """Prepare nothing yet.

        Args:
            renderers: Traces the rays.
            summarizer: Has the scene.
        """
        self._renderers = renderers
        self._summarizer = summarizer
        self._labels: LabelRenderer | None = None
        self._last: LruDict[Channel, _LastExposure] = LruDict(_MAX_LAST_STATES)

    def label(
        self,
        drawn: DrawnExposure,
        names: tuple[str, ...],
        channel: Channel,
        time_s: float,
        found_beside: PixelLabels | None = None,
    ) -> FrameLabels:
        """Labels of a view; see `ViewCache.label`."""
        _require_room(drawn, names)
        last = self._last.get(channel) if "flow" in names else None
        other = None if last is None else last.camera_state
        try:
            truth = self._open_labels().render(drawn, names, other, found_beside)
        except (DomainError, RendererUnavailableError) as error:
            raise ViewFailedError(f"no labels: {error}") from error
        if "flow" in names:
            self._last.put(channel, _LastExposure(time_s, drawn.camera_state))
        return FrameLabels(
            truth,
            has_row_times=drawn.ray_source.readout_s > 0.0,
            is_displaced=any(isinstance(one, Misalignment) for one in drawn.image_effects),
            flow_to_time_s=None if last is None else last.time_s,
        )

    def request(self, drawn: DrawnExposure, names: tuple[str, ...]) -> LabelRequest | None:
        """Labels that can be found while a view is drawn; see `LabelRenderer.request`."""
        try:
            _require_room(drawn, names)
            return self._open_labels().request(drawn, names)
        except (DomainError, RendererUnavailableError, ViewFailedError):
            # Reported by `label`, after a picture that is as good without.
            return None

    def _open_labels(self) -> LabelRenderer:
        """Labels of the scene, made at the first request."""
        if self._labels is None:
            tracer = self._renderers.get_tracer()
            # Imported here: a server without Embree runs, without labels.
            from catoptra_server.ground_truth.label_renderer import LabelRenderer

            self._labels = LabelRenderer(tracer, self._summarizer.scene)
        return self._labels

    def close(self) -> None:
        """Free all rays."""
        if self._labels is not None:
            self._labels.close()
        self._labels = None


def _require_room(drawn: DrawnExposure, names: tuple[str, ...]) -> None:
    """Raise ViewFailedError for channels that take too much memory."""
    camera = drawn.camera
    channels = [LABEL_CHANNELS[name] for name in names]
    size = count_bytes(channels, camera.height_px, camera.width_px)
    if size > MAX_CHANNEL_BYTES:
        raise ViewFailedError(
            f"no labels: the channels {', '.join(names)} of {camera.width_px} x "
            f"{camera.height_px} px take {size / 2**20:.0f} MiB, more than "
            f"{MAX_CHANNEL_BYTES // 2**20}: request fewer channels at a time"
        )
