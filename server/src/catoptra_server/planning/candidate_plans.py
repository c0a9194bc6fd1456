"""Candidate plans of a camera, and the few of them that are timed: the settings of each renderer.

Candidates vary every number of a plan in useful steps; some 130 for a camera with both renderers.
Mesh and exact mirror are never exchanged for each other: a mesh costs more and shows less, but a
robot's file that has one describes its mirror.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator
from dataclasses import replace

from catoptra_protocol.optics.omni_camera import OmniCamera
from catoptra_server.planning.explicit_plan import needs_exact_rays, plan_from_settings
from catoptra_server.planning.view_size import plan_view_size
from catoptra_server.render.render_settings import MirrorSurface, RenderSettings
from catoptra_server.render.renderer import RenderPlan
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.runtime.memory import DEFAULT_LIMIT_BYTES

SAMPLE_COUNTS = tuple(range(1, 9))
# Below half a texel a pixel a face blurs the image; above four the atlas costs time for no detail.
TEXELS_PER_PX = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0)
FACE_SAMPLE_COUNTS = (1, 4)

# (samples, texels a pixel, samples a texel): each rate of the raster stages in `cost_model` has a
# plan that differs from the first in its quantity.
_RASTER_CALIBRATION = ((1, 0.5, 1), (4, 1.0, 1), (1, 1.5, 1), (1, 1.0, 4))
# Samples along a pixel's side: the plans used most, and one with many samples for the third rate.
_TRACE_CALIBRATION = (1, 2, 5)


def generate_candidate_plans(
    surface: MirrorSurface, camera: OmniCamera, kinds: Iterable[RendererKind]
) -> Iterator[RenderPlan]:
    """Yield all plans by which some renderers can render a camera."""
    for kind in kinds:
        if needs_exact_rays(camera, kind):
            continue
        for settings in _candidate_settings(surface, kind):
            # Faces and mesh limits depend on all numbers but the samples: computed once for eight.
            plan = plan_from_settings(settings, camera, kind=kind, reason="candidate")
            yield from _fitting_plans(
                camera, [replace(plan, samples=samples) for samples in SAMPLE_COUNTS]
            )


def _fitting_plans(camera: OmniCamera, plans: Iterable[RenderPlan]) -> Iterator[RenderPlan]:
    """Yield the plans within the default memory limit, and those with the fewest samples.

    A client's accuracy target must not take more memory than a robot's file may request.
    """
    for plan in plans:
        is_smallest = plan.samples == 1 and plan.face_samples == 1
        if is_smallest or plan_view_size(camera, plan).num_bytes <= DEFAULT_LIMIT_BYTES:
            yield plan


def _candidate_settings(surface: MirrorSurface, kind: RendererKind) -> Iterator[RenderSettings]:
    """Yield the candidates' settings, all numbers but the samples."""
    base = RenderSettings(surface)
    if kind is RendererKind.TRACE:
        yield base
        return
    for texels_per_px in TEXELS_PER_PX:
        for samples in FACE_SAMPLE_COUNTS:
            yield replace(base, texels_per_px=texels_per_px, face_samples=samples)


def generate_calibration_plans(
    kind: RendererKind, camera: OmniCamera, surface: MirrorSurface
) -> Iterator[RenderPlan]:
    """Yield the plans whose times determine the rates of all candidates of one renderer.

    One that would take too much memory has fewer samples, as candidates have.
    """
    for settings in _calibration_settings(kind, surface):
        plan = plan_from_settings(settings, camera, kind=kind, reason="calibration")
        fewer = (replace(plan, samples=samples) for samples in range(plan.samples, 0, -1))
        yield from itertools.islice(_fitting_plans(camera, fewer), 1)


def _calibration_settings(kind: RendererKind, surface: MirrorSurface) -> Iterator[RenderSettings]:
    base = RenderSettings(surface)
    if kind is RendererKind.TRACE:
        for samples in _TRACE_CALIBRATION:
            yield replace(base, samples=samples)
        return
    for samples, texels_per_px, face_samples in _RASTER_CALIBRATION:
        yield replace(base, samples=samples, texels_per_px=texels_per_px, face_samples=face_samples)
