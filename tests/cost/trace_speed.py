"""The trace renderer against Embree, interleaved in one run, in four scenes.

Run: OPENBLAS_NUM_THREADS=1 PYTHONPATH=tests .venv/bin/python -m cost.trace_speed

Prints, for each scene and size, the milliseconds of a frame by the product's public interface, by
embreex's `run` and NumPy (`embreex_numpy.py`), and of bare rays: the kernel's, and Embree's packets
in C (`embree_packets.c`), with a moving camera and one sample a pixel; the medians of their ratios
with quartiles beside the required ones; and how far the two pictures differ. Without the package
embreex, which `make bench` installs, its columns are empty. Then 2 x 2 samples, shadows and sixteen
robots. Writes out/bench/trace_speed.json. Machines are noisy: compare ratios, not milliseconds.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from rich.console import Console

from catoptra_server.config.world_file import read_world
from catoptra_server.world.world_description import World
from catoptra_studies.accuracy_cost.cost_command import describe_machine
from cost.trace_cells import (
    HAS_EMBREEX,
    Cell,
    CellRow,
    CostRow,
    Racers,
    make_states,
    measure_cell,
    measure_cost,
)
from cost.trace_scenes import make_trace_worlds
from cost.trace_table import describe_bare_rays, make_cell_table, make_cost_table
from measurements.scenes import CORRIDOR, make_robots

ROOT = Path(__file__).parents[2]
OUTPUT = ROOT / "out/bench"
SIZES = (360, 640, 1024)
DEFAULT_SIZE_PX = 640
# Least factor over embreex with NumPy by size, and least share of the rate of bare rays.
REQUIRED = {
    "field": ((2.7, 4.0, 4.5), 0.7),
    "clutter": ((1.8, 3.5, 3.8), 0.7),
    "million": ((1.4, 1.9, 2.2), 0.7),
    "textured": ((5.0, 5.0, 5.0), 0.5),
}
# 2 x 2 samples at 640 px: a frame may take 60 % of the frame of 2026-11, before the native kernel.
# That renderer's factor over embreex with NumPy was measured by this script; it stands for its
# time on any machine.
FACTOR_BEFORE_KERNEL = {"field": 3.8, "corridor": 3.7}
MAX_SHARE_OF_BEFORE = 0.6
# Greatest time of the kernel's bare rays over that of Embree's packets.
MAX_BARE_RATIO, MAX_MEAN_BARE_RATIO = 0.75, 0.65
MAX_SHADOW_RATIO, MAX_ROBOTS_RATIO = 1.6, 1.2
ROBOTS = 16
NUM_COST_ROWS = 4  # shadows and robots, with one sample and with 2 x 2
# Time of all rows together, building the scenes included, and of one row.
TOTAL_S, MIN_ROW_S, MAX_ROW_S = 190.0, 0.5, 4.5


@dataclass(slots=True)
class Timetable:
    """Time that each row may take, so that all end in time on a busy machine, too."""

    rows_left: int
    end: float
    """Reading of the performance counter."""

    def next_row_s(self) -> float:
        """Seconds of the next row."""
        fair_s = (self.end - time.perf_counter()) / self.rows_left
        self.rows_left -= 1
        return min(max(fair_s, MIN_ROW_S), MAX_ROW_S)


def main() -> int:
    """Measure all rows, print them and write the file."""
    console, begin = _open_console(), time.perf_counter()
    if not HAS_EMBREEX:
        console.print("no columns of Embree: the package embreex is not installed", style="red")
    worlds = make_trace_worlds(OUTPUT / "scenes") | {"corridor": read_world(CORRIDOR)[0]}
    num_rows = sum(len(list(_make_cells(name))) for name in worlds) + NUM_COST_ROWS
    timetable = Timetable(num_rows, begin + TOTAL_S)
    cells: list[CellRow] = []
    costs: list[CostRow] = []
    for name, world in worlds.items():
        with _open_racers(name, world, console) as racers:
            for cell in _make_cells(name):
                cells.append(measure_cell(racers, cell, seconds=timetable.next_row_s()))
            costs += _measure_costs(racers, timetable) if name == "field" else ()
    console.print(make_cell_table(cells), describe_bare_rays(cells, MAX_MEAN_BARE_RATIO))
    console.print(make_cost_table(costs))
    elapsed_s = time.perf_counter() - begin
    console.print(f"{describe_machine()}, {elapsed_s:.0f} s in all", highlight=False)
    _write_rows(cells, costs)
    return 0


def _write_rows(cells: list[CellRow], costs: list[CostRow]) -> None:
    """Write all rows as JSON."""
    document = {
        "machine": describe_machine(),
        "load_average": os.getloadavg(),
        "cells": [asdict(row) for row in cells],
        "costs": [asdict(row) for row in costs],
    }
    OUTPUT.mkdir(parents=True, exist_ok=True)
    (OUTPUT / "trace_speed.json").write_text(json.dumps(document, indent=2) + "\n", "utf-8")


def _open_console() -> Console:
    """Console that is wide enough for the table where the output is a file."""
    console = Console()
    return console if console.is_terminal else Console(width=200)


@contextmanager
def _open_racers(name: str, world: World, console: Console) -> Iterator[Racers]:
    """Both renderers of a world; the console names them."""
    racers = Racers.open(world)
    console.print(f"{name}: {racers.choice.renderer.describe()}", highlight=False)
    yield racers
    racers.close()


def _make_cells(name: str) -> Iterator[Cell]:
    """Yield the rows of a world against Embree."""
    if name in REQUIRED:
        factors, bare_share = REQUIRED[name]
        for size_px, factor in zip(SIZES, factors, strict=True):
            yield Cell(name, size_px, 1, factor, bare_share, MAX_BARE_RATIO)
    if name in FACTOR_BEFORE_KERNEL:
        factor = FACTOR_BEFORE_KERNEL[name] / MAX_SHARE_OF_BEFORE
        yield Cell(name, DEFAULT_SIZE_PX, 2, factor)


def _measure_costs(racers: Racers, timetable: Timetable) -> Iterator[CostRow]:
    """Yield the rows of shadows and robots against none."""
    shadowed = make_states(has_shadows=True)
    with_robots = make_states(make_objects=lambda turn: make_robots(ROBOTS, turn_rad=turn))
    for samples in (1, 2):
        view, shape = racers.prepare(DEFAULT_SIZE_PX, samples), (DEFAULT_SIZE_PX, samples)
        for what, changed, max_ratio in (
            ("shadows", shadowed, MAX_SHADOW_RATIO),
            (f"{ROBOTS} robots", with_robots, MAX_ROBOTS_RATIO),
        ):
            yield measure_cost(
                view,
                what,
                changed=changed,
                max_ratio=max_ratio,
                shape=shape,
                seconds=timetable.next_row_s(),
            )
        view.close()


if __name__ == "__main__":
    sys.exit(main())
