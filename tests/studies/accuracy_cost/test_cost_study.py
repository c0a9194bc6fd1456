from __future__ import annotations

from dataclasses import replace

import pytest

from catoptra_protocol.optics.mirrors import HyperbolicMirror
from catoptra_studies.accuracy_cost.cost_results import PolygonRow
from catoptra_studies.accuracy_cost.cost_study import measure_polygon_rows
from helpers.worlds import make_omni_camera

# k and c of the paper; the rim at 120 degrees.
CAMERA = make_omni_camera(width_px=100)


@pytest.fixture(scope="module")
def rows() -> tuple[PolygonRow, ...]:
    return measure_polygon_rows(CAMERA)


def test_table_has_ten_tessellations_with_both_interpolations(rows: tuple[PolygonRow, ...]) -> None:
    assert len({(row.sectors, row.rings, row.interpolation) for row in rows}) == 20


def test_rows_agree_with_the_reference_but_for_the_two_ring_uv_mesh(
    rows: tuple[PolygonRow, ...],
) -> None:
    # Its polygons reach beyond the horizon from a side face's middle to its far side: what such
    # texture coordinates show is a choice, and ours keeps them finite.
    others = {
        (row.sectors, row.rings, row.interpolation) for row in rows if not row.agrees_with_reference
    }
    assert others == {(8, 2, "uv")}


def test_row_when_rms_is_four_percent_off_disagrees_by_position_only() -> None:
    row = PolygonRow(16, 4, 4, "position", 0.6, 1.04, 1.0, 1.0, 1.0)
    assert not row.agrees_with_reference
    assert replace(row, interpolation="uv").agrees_with_reference


def test_reference_is_not_for_another_mirror() -> None:
    rows = measure_polygon_rows(make_omni_camera(mirror=HyperbolicMirror(8.0, 0.2321)))
    assert {(row.reference_rms_px, row.reference_max_px) for row in rows} == {(0.0, 0.0)}
