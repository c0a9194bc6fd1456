"""Tables of the comparison of ray tracers."""

from __future__ import annotations

import statistics

from rich.table import Table

from cost.race import Quartiles
from cost.trace_cells import CellRow, CostRow


def make_cell_table(rows: list[CellRow]) -> Table:
    """Table of ours against embreex with NumPy, and of bare rays against Embree's packets."""
    table = Table(
        title="ms a frame; bare, Embree's packets: hits alone; ratios: medians, (quartiles), bars"
    )
    table.add_column("scene", no_wrap=True)
    heads = ["px", "ours", "embreex", "bare", "packets", "embreex/ours", "processor"]
    heads += ["required", "bare/ours", "required", "bare/packets", "allowed", "differ", "max"]
    for head in heads:
        table.add_column(head, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(*_format_cell(row))
    return table


def _format_cell(row: CellRow) -> tuple[str, ...]:
    cell, times = row.cell, row.wall_ms
    return (
        cell.scene,
        _format_size(cell.size_px, cell.samples),
        f"{times['ours']:.1f}",
        f"{times['embreex']:.1f}" if "embreex" in times else "-",
        f"{times['bare']:.1f}" if "bare" in times else "-",
        f"{times['packets']:.1f}" if "packets" in times else "-",
        _format_quartiles(row.factor),
        "-" if row.processor_factor is None else f"{row.processor_factor.median:.2f}",
        _format_bound(row.factor, cell.required_factor, is_minimum=True),
        _format_quartiles(row.bare_share),
        _format_bound(row.bare_share, cell.required_bare_share, is_minimum=True),
        _format_quartiles(row.bare_ratio),
        _format_bound(row.bare_ratio, cell.max_bare_ratio, is_minimum=False),
        "-" if row.different_share is None else f"{row.different_share:.1e}",
        "-" if row.max_difference is None else f"{row.max_difference}",
    )


def describe_bare_rays(rows: list[CellRow], max_mean: float) -> str:
    """Geometric mean of the bare rays' ratios where one is allowed, with its bar."""
    ratios = [row.bare_ratio.median for row in rows if row.bare_ratio and row.cell.max_bare_ratio]
    if not ratios:
        return "bare/packets: not measured"
    mean = statistics.geometric_mean(ratios)
    missed = ", [red]missed[/red]" if mean > max_mean else ""
    return f"bare/packets: {mean:.2f} in geometric mean, allowed {max_mean:.2f}{missed}"


def make_cost_table(rows: list[CostRow]) -> Table:
    """Table of frames with something against frames without."""
    table = Table(title="field, ms a frame with and without; ratio: median, (quartiles), allowed")
    table.add_column("", no_wrap=True)
    for head in ("px", "with", "without", "with/without", "processor", "allowed"):
        table.add_column(head, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(
            row.what,
            _format_size(row.size_px, row.samples),
            f"{row.wall_ms['with']:.1f}",
            f"{row.wall_ms['without']:.1f}",
            _format_quartiles(row.ratio),
            f"{row.processor_ratio.median:.2f}",
            _format_bound(row.ratio, row.max_ratio, is_minimum=False),
        )
    return table


def _format_size(size_px: int, samples: int) -> str:
    """Pixels along a side; samples along a pixel's side where there are several."""
    return f"{size_px}" if samples == 1 else f"{size_px}, {samples} x {samples}"


def _format_quartiles(value: Quartiles | None) -> str:
    """Median and quartiles; a dash for none."""
    if value is None:
        return "-"
    return f"{value.median:.2f} ({value.lower:.2f}-{value.upper:.2f})"


def _format_bound(value: Quartiles | None, bound: float | None, *, is_minimum: bool) -> str:
    """A bound, red where the median misses it."""
    if bound is None:
        return ""
    text = f"{bound:.2f}"
    if value is None:
        return text
    is_met = value.median >= bound if is_minimum else value.median <= bound
    return text if is_met else f"[red]{text}, missed[/red]"
