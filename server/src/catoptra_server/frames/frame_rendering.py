"""One frame of a request: all views rendered, composed into one image, with the frame's numbers."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Protocol

import numpy as np

from catoptra_server.frames.frame import Frame
from catoptra_server.frames.frame_labels import FrameLabels
from catoptra_server.frames.frame_plan import ViewState
from catoptra_server.frames.frame_request import (
    Channel,
    FrameComposition,
    FrameRequest,
    ViewRequest,
)
from catoptra_server.frames.image_difference import append_difference
from catoptra_server.frames.multi_view import compose_tiles
from catoptra_server.frames.view_cache import RenderedView
from catoptra_server.ground_truth.label_rays import DrawnExposure
from catoptra_server.planning.camera_spec import OmniCameraSpec
from catoptra_server.render.renderer import Image
from catoptra_server.render.trace.trace_engine import LabelRequest


class ViewProvider(Protocol):
    """Source of rendered views; the server's is `ViewCache`."""

    def render(self, request: ViewRequest) -> RenderedView:
        """Render a view."""

    def label(
        self, rendered: RenderedView, channels: tuple[str, ...], channel: Channel, time_s: float
    ) -> FrameLabels:
        """Label the pixels of a rendered view."""

    def request_labels(
        self, channels: tuple[str, ...], exposure: DrawnExposure
    ) -> LabelRequest | None:
        """Labels of channels that can be found while a view is drawn."""

    def view_state(self, camera: OmniCameraSpec) -> ViewState:
        """Plan that the next frame of a camera will have; prepares no view."""

    def close(self) -> None:
        """Close all views and renderers."""


def render_frame(
    request: FrameRequest, views: ViewProvider | None, *, monotonic: Callable[[], float]
) -> Frame:
    """Render all views of a request and compose the frame; black without a view provider."""
    composition = request.composition
    begin_s = monotonic()
    rendered = [
        None if view is None or views is None else views.render(_with_labels(view, request, views))
        for view in composition.views
    ]
    rgb = _turn(composition, _compose_image(composition, rendered))
    difference = None
    if composition.reference is not None and views is not None:
        reference = views.render(composition.reference)
        reference_rgb = _turn(composition, reference.image.rgb)
        rgb, difference = append_difference(rgb, reference_rgb, reference.frame_plan.plan_text)
    labels = None
    if composition.channels and views is not None and rendered[0] is not None:
        labels = views.label(rendered[0], composition.channels, request.channel, request.time_s)
        labels = labels.turn() if composition.is_turned else labels
    # Up to here the duration counts: the rest gathers numbers.
    end_s = monotonic()
    present = [view for view in rendered if view is not None]
    single = present[0] if len(rendered) == len(present) == 1 else None
    bounds = max_bounds(view.frame_plan.bounds for view in present)
    return Frame(
        sequence=request.sequence,
        time_s=request.time_s,
        rgb=rgb,
        exposed_at_s=request.exposed_at_s,
        finished_at_s=end_s,
        channel=request.channel,
        metadata=composition.metadata,
        stage_ms=_sum_stages(present),
        render_duration_s=end_s - begin_s,
        # A set: cameras of one class share a plan.
        plan="; ".join(sorted({view.frame_plan.plan_text for view in present})) or None,
        error_bound_px=bounds["outline_px"] if bounds else None,
        error_bounds=bounds,
        # In a list of several cameras' decisions the camera of each would be lost.
        effect_decisions=single.effect_decisions if single else (),
        choice=single.frame_plan.choice if single else None,
        difference=difference,
        labels=labels,
    )


def _with_labels(view: ViewRequest, request: FrameRequest, views: ViewProvider) -> ViewRequest:
    """Request of a view with the labels of its frame."""
    channels = request.composition.channels
    if not channels:
        return view
    return replace(view, request_labels=partial(views.request_labels, channels))


def _sum_stages(views: Sequence[RenderedView]) -> dict[str, float]:
    """Milliseconds of each stage, over all views of a frame."""
    stage_ms: dict[str, float] = {}
    for view in views:
        for name, ms in view.image.stage_ms.items():
            stage_ms[name] = stage_ms.get(name, 0.0) + ms
    return stage_ms


def max_bounds(bounds: Iterable[Mapping[str, float] | None]) -> dict[str, float] | None:
    """Largest value of each error bound, over all views of a frame.

    Returns:
        The bounds by name; None for a frame without views, or with a view without bounds.
    """
    views = list(bounds)
    known = [view for view in views if view is not None]
    if not known or len(known) < len(views):
        return None
    if len(known) == 1:  # of most frames: 10 microseconds less
        return dict(known[0])
    names = dict.fromkeys(name for view in known for name in view)
    return {name: max(view.get(name, 0.0) for view in known) for name in names}


def _turn(composition: FrameComposition, image: Image) -> Image:
    """The image, turned round left to right where the composition says so."""
    # A copy: encoders and raw frames want rows without gaps.
    return np.ascontiguousarray(image[:, ::-1]) if composition.is_turned else image


def _compose_image(composition: FrameComposition, rendered: Sequence[RenderedView | None]) -> Image:
    """Image of all tiles."""
    images = [view.image.rgb if view else None for view in rendered]
    first, layout = images[0], composition.layout
    # A single view that fills the frame is the frame: no copy of a megabyte.
    if len(images) == 1 and first is not None and first.shape[:2] == layout.shape:
        return first
    return compose_tiles(layout, images)
