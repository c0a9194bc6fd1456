"""The proof from outside: every comparison with foreign programs; writes docs/PROOF.md.

Run: make outside, or PYTHONPATH=tests .venv/bin/python -m outside.run [PART ...]

Exit status 0: all differences are within their bounds, and every model that is changed by 1e-4 is
noticed; 1: not; 2: a foreign program is missing. Parts: lenses, mirrors, discs, labels, boards; the
page is written by a run of all of them alone.
"""

from __future__ import annotations

import importlib
import math
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any

from catoptra_studies.accuracy_cost.cost_command import describe_machine
from outside import boards, discs, labels, lenses, mirrors
from outside.findings import Finding, mutants, version_of

PAGE = Path(__file__).parents[2] / "docs/PROOF.md"
PROGRAMS = ("mitsuba", "pycolmap", "ds_msp", "astropy", "scipy", "cv2")
INSTALL = "pip install 'catoptra-server[outside]', then pip install --no-deps ds-msp==0.22.2"

# A comparison, or the name of a mutant and whether it was noticed.
Result = Finding | tuple[str, bool]


@dataclass(frozen=True, slots=True)
class Part:
    """One section of the page."""

    title: str
    text: str
    run: Callable[[], Iterator[Result]]


def _with_mutants(
    cases: Callable[[], list[Any]],
    compare: Callable[..., Iterable[Finding]],
    limit: int | None = None,
) -> Callable[[], Iterator[Result]]:
    """Compare cases, and mutants of their cameras, all or the first ones."""

    def run() -> Iterator[Result]:
        for case in cases():
            yield from compare(case)
            for name, camera in islice(mutants(case.camera), limit):
                noticed = not all(finding.holds for finding in compare(case, camera))
                yield f"{case.name}: {name}", noticed

    return run


PARTS = {
    "lenses": Part(
        "Lenses",
        "Pixels of 100 000 directions up to the rim, numbers mostly of shipped cameras. All "
        "programs compute in float64. DS-MSP's OCam is not asked within 0.06 degrees of 90, where "
        "its Newton iteration misses the root; COLMAP's and OpenCV's fish-eyes end at 90 degrees. "
        "WCSLIB, in astropy, has lenses as its zenithal projections ARC, ZEA, STG, SIN and ZPN.",
        _with_mutants(lenses.lens_cases, lenses.compare_lens),
    ),
    "mirrors": Part(
        "Mirrors, by formula",
        "Pixels of 20 000 points at 0.15 to 3 m: the law of reflection on the published surface, "
        "solved by bisection, transcribed and not a foreign program; and points of the surface.",
        _with_mutants(mirrors.mirror_cases, mirrors.compare_mirror),
    ),
    "discs": Part(
        "Mirrors, drawn by Mitsuba",
        "Discs of 5 to 50 px^2 at 0.15, 0.3, 1 and 3 m, images of 360 px: distances of centroids "
        "in Mitsuba's pictures from those in ours, and the standard error (median) of each. The "
        "mirror is a smooth conductor that Mitsuba traces in float32: a sphere of its own, else a "
        "mesh of 720 x 720 facets with normals of the publication's surface. Innermost 8 degrees, "
        "of a cone from its apex: here the mesh ends in needles around its hub, and a cone draws a "
        "disc as an arc thinner than a pixel, so no bound is required. Mitsuba starts a reflected "
        "ray 9e-5 of its largest coordinate off the surface: up to 0.01 px at 0.15 m on the cone. "
        "Scale: the factor between positions about the centre, less 1; it notices a mutant.",
        _with_mutants(mirrors.mirror_cases, discs.compare_discs, 1),
    ),
    "labels": Part(
        "Labels and ranges",
        "Ids and ranges of all pixels of 360 px, in a world of 28 boxes and 8 rectangles, against "
        "a float64 caster that knows these as numbers, with rays of the publications. Where rays "
        "1e-4 px from the centre differ, an edge runs through the centre and either id is right.",
        _with_mutants(labels.label_cases, labels.compare_labels, 1),
    ),
    "boards": Part(
        "The paper's geometry",
        "OpenCV finds corners of chessboards in pictures of ours and calibrates its unified model; "
        "xi and gamma follow from the paper's k = 11.546.",
        boards.compare_calibration,
    ),
}  # fmt: skip


def main(arguments: list[str]) -> int:
    """Run parts, all by default; all write the page. Answers with the exit status."""
    missing = [program for program in PROGRAMS if not _is_installed(program)]
    if missing:
        print(f"the proof from outside needs {', '.join(missing)}: {INSTALL}")
        return 2
    begin = time.perf_counter(), time.process_time()
    found = {name: list(map(_show, PARTS[name].run())) for name in arguments or PARTS}
    wall_s, processor_s = time.perf_counter() - begin[0], time.process_time() - begin[1]
    took = f"{wall_s / 60.0:.1f} minutes, {processor_s / 60.0:.1f} of processor time"
    print(took)
    if not arguments:
        PAGE.write_text(make_page(found, took), encoding="utf-8")
    return int(not all(_is_right(result) for results in found.values() for result in results))


def _is_installed(module: str) -> bool:
    with suppress(ImportError):
        importlib.import_module(module)
        return True
    return False


def _show(result: Result) -> Result:
    if isinstance(result, Finding):
        mark = "" if result.holds else "  EXCEEDED"
        print(f"{result.subject}, {result.authority}: {result.largest:.1e}{mark}", flush=True)
    elif not result[1]:
        print(f"mutant of 1e-4 not noticed: {result[0]}", flush=True)
    return result


def _is_right(result: Result) -> bool:
    return result.holds if isinstance(result, Finding) else result[1]


def make_page(found: dict[str, list[Result]], took: str) -> str:
    """Text of docs/PROOF.md."""
    results = [result for each in found.values() for result in each]
    rows = [_is_right(result) for result in results if isinstance(result, Finding)]
    seen = [_is_right(result) for result in results if not isinstance(result, Finding)]
    lines = [
        "# Proof from outside",
        "",
        "What this repository computes, compared with programs that share no code with it.",
        "",
        f"* {sum(rows)} of {len(rows)} differences are within their bounds.",
        f"* {sum(seen)} of {len(seen)} mutants are noticed: models with one number changed by 1e-4 "
        "of itself, in each model. Pictures notice the scale; smaller parts, such as a k that is "
        "1e-4 larger (2e-4 px), formulas alone.",
        f"* Measured {datetime.now(UTC):%Y-%m-%d}, {version_of('catoptra-server')}, in {took}: "
        f"{describe_machine()}.",
        "* To repeat: `make outside` installs the programs (0.7 GB), compares everything and "
        "writes this page. It ends with 1 when a difference exceeds its bound or a mutant is not "
        "noticed. `tests/outside` has the comparisons.",
        "",
        '"Transcribed" is a formula that the measurement has from the publication; every other '
        "row is a program with its version. Largest and median are absolute differences.",
    ]
    for name, part in PARTS.items():
        lines += ["", f"## {part.title}", "", part.text, ""]
        lines += _format_table([row for row in found[name] if isinstance(row, Finding)])
    return "\n".join(lines) + "\n"


def _format_table(rows: list[Finding]) -> list[str]:
    """Lines of a table, without columns that have no entry."""
    columns = {
        "what": [row.subject for row in rows],
        "compared with": [row.authority for row in rows],
        "number": [str(row.count) for row in rows],
        "largest": [_quantity(row.largest, row.unit) for row in rows],
        "median": [_quantity(row.median, row.unit) for row in rows],
        "bound": [_quantity(row.bound, row.unit) for row in rows],
        "standard error": [row.error for row in rows],
        "note": [row.note for row in rows],
    }
    filled = {name: cells for name, cells in columns.items() if any(cells)}
    table = [tuple(filled), ("---",) * len(filled), *zip(*filled.values(), strict=True)]
    return [f"| {' | '.join(cells)} |" for cells in table]


def _quantity(value: float, unit: str) -> str:
    return "none" if math.isinf(value) else f"{value:.2g} {unit}".strip()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
