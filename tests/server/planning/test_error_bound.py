"""Composition and text of bounds; tests/server/render/test_error_bound.py tests that they hold."""

from __future__ import annotations

import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.mirrors import ParabolicMirror
from catoptra_server.frames.plan.error_bound import ErrorBound, error_bound
from catoptra_server.frames.plan.plans import plan_from_settings
from catoptra_server.render.render_settings import MirrorSurface, PerPixel, RenderSettings
from catoptra_server.render.renderer import RenderPlan
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.world.mirror_mesh import Interpolation, Tessellation
from helpers.worlds import make_omni_camera

CAMERA = make_omni_camera(width_px=360)
TRACE, RASTER = RendererKind.TRACE, RendererKind.RASTER


def make_plan(kind: RendererKind, surface: MirrorSurface, samples: int = 2) -> RenderPlan:
    return plan_from_settings(RenderSettings(surface, samples), CAMERA, kind=kind, reason="test")


def make_bound(kind: RendererKind, surface: MirrorSurface) -> ErrorBound:
    return error_bound(CAMERA, make_plan(kind, surface))


@pytest.mark.parametrize(
    ("kind", "surface", "names"),
    [
        (TRACE, PerPixel(), ["rounding"]),
        (RASTER, PerPixel(), ["faces", "rounding"]),
        (TRACE, Tessellation(16, 16), ["polygons", "rounding", "rim"]),
        (RASTER, Tessellation(16, 16), ["polygons", "faces", "corners", "rounding", "rim"]),
    ],
    ids=["trace", "raster", "traced polygons", "rastered polygons"],
)
def test_bound_has_the_components_of_its_plan_with_reasons(
    kind: RendererKind, surface: MirrorSurface, names: list[str]
) -> None:
    parts = make_bound(kind, surface).components
    assert [part.name for part in parts] == names
    assert all(part.reason and part.max_px > 0.0 for part in parts)


def test_components_add_up_but_for_the_rim() -> None:
    whole = make_bound(RASTER, Tessellation(16, 16))
    added = sum(part.max_px for part in whole.components if part.name != "rim")
    assert whole.geometric.max_px == pytest.approx(added)


def test_rim_dominates_with_few_sectors_and_many_rings() -> None:
    camera = make_omni_camera(width_px=360, rim_deg=60.0)
    tessellation = Tessellation(8, 64, Interpolation.POSITION)
    few = plan_from_settings(RenderSettings(tessellation), camera, kind=TRACE, reason="test")
    whole = error_bound(camera, few)
    rim = {part.name: part.max_px for part in whole.components}["rim"]
    assert whole.geometric.max_px == rim


def test_repeated_bound_is_cached() -> None:
    assert make_bound(RASTER, Tessellation(8, 8)) is make_bound(RASTER, Tessellation(8, 8))


def test_bound_as_a_dict_has_a_number_for_each_name() -> None:
    numbers = make_bound(RASTER, PerPixel()).as_dict()
    assert set(numbers) == {
        *("max_px", "rms_px", "max_deg", "rms_deg"),
        *("edge_px", "outline_px", "marker_px"),
        *("texels_per_px_min", "texels_per_px_median", "texels_per_px_max"),
        *("faces_px", "rounding_px"),
    }
    assert all(isinstance(value, float) for value in numbers.values())
    assert "texels_per_px_min" not in make_bound(TRACE, PerPixel()).as_dict()


def test_marker_error_is_the_sum_of_both() -> None:
    whole = make_bound(RASTER, PerPixel())
    assert whole.marker_error_px == whole.geometric.max_px + whole.sampling.centroid_error_px


def test_bound_when_printed_names_total_components_and_samples() -> None:
    text = str(make_bound(RASTER, Tessellation(16, 16)))
    assert text.startswith("displaced by at most 7.9")
    assert "(polygons 7.3, faces 0.58, " in text
    assert "samples add 0.35 px" in text
    assert text.endswith("texels a px, undersampled")


def test_bound_of_trace_when_printed_has_no_texels() -> None:
    assert "texels" not in str(make_bound(TRACE, PerPixel()))


def test_mesh_under_an_orthographic_camera_has_no_bound() -> None:
    camera = make_omni_camera(mirror=ParabolicMirror(0.03))
    with pytest.raises(DomainError, match="pinhole"):
        error_bound(camera, make_plan(TRACE, Tessellation(8, 8)))


def test_outline_error_is_displacement_plus_sampling() -> None:
    whole = make_bound(RASTER, PerPixel())
    assert whole.outline_error_px == whole.geometric.max_px + whole.sampling.edge_error_px
