"""The proof from outside: every comparison with foreign programs; writes docs/PROOF.md.

Run: make outside, or PYTHONPATH=tests .venv/bin/python -m outside.run [PART ...]

Exit status 0: all differences are within their bounds, and every model that is changed by 1e-4 is
noticed; 1: not; 2: a foreign program is missing. Parts: lenses, mirrors, discs, labels, boards.
Findings of each part are kept in out/outside; the page has all parts, and is written once all have
run.
"""

from __future__ import annotations

import json
import math
import platform
import sys
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from outside import boards, discs, labels, lenses, mirrors
from outside.findings import MUTATION, Finding, is_installed, mutants

ROOT = Path(__file__).parents[2]
OUTPUT = ROOT / "out/outside"
PAGE = ROOT / "docs/PROOF.md"
PROGRAMS = ("mitsuba", "pycolmap", "ds_msp", "astropy", "scipy", "cv2")
INSTALL = "pip install 'catoptra-server[outside]', then pip install --no-deps ds-msp==0.22.2"
# Discs at each of four distances; Mitsuba's samples a pixel, a square, by each of four seeds.
_DISCS, _SAMPLES = 4, 144

# Whether a mutant was noticed, by its name.
Noticed = tuple[str, bool]


@dataclass(frozen=True, slots=True)
class Part:
    """One section of the page."""

    title: str
    text: str
    run: Callable[[], Iterator[Finding | Noticed]]


def _is_noticed(findings: Iterable[Finding]) -> bool:
    return not all(finding.holds for finding in findings)


def _run_lenses() -> Iterator[Finding | Noticed]:
    for case in lenses.lens_cases():
        yield from lenses.compare_lens(case)
        for name, camera in mutants(case.camera):
            yield f"{case.name}: {name}", _is_noticed(lenses.compare_lens(case, camera))


def _run_mirrors() -> Iterator[Finding | Noticed]:
    for case in mirrors.mirror_cases():
        yield from mirrors.compare_mirror(case)
        for name, camera in mutants(case.camera):
            yield f"{case.name}: {name}", _is_noticed(mirrors.compare_mirror(case, camera))


def _run_discs() -> Iterator[Finding | Noticed]:
    for case in mirrors.mirror_cases():
        *found, mutant = discs.compare_discs(case, per_distance=_DISCS, samples=_SAMPLES)
        yield from found
        yield f"{case.name} drawn: scale", not mutant.holds


def _run_labels() -> Iterator[Finding | Noticed]:
    for name, camera, rays in labels.label_cases():
        yield from labels.compare_labels(name, camera, rays)
        mutant = replace(camera, scale_px=camera.scale_px * (1.0 + MUTATION))
        noticed = _is_noticed(labels.compare_labels(name, camera, rays, mutant))
        yield f"{name} labelled: scale", noticed


def _run_boards() -> Iterator[Finding | Noticed]:
    yield from boards.compare_calibration()


PARTS = {
    "lenses": Part(
        "Lenses",
        "Pixels of 100 000 directions up to the rim, numbers mostly of shipped cameras. All "
        "programs compute in float64. DS-MSP's OCam is not asked within 0.06 degrees of 90, where "
        "its Newton iteration misses the root; COLMAP's and OpenCV's fish-eyes end at 90 degrees. "
        "WCSLIB, in astropy, has lenses as its zenithal projections ARC, ZEA, STG, SIN and ZPN.",
        _run_lenses,
    ),
    "mirrors": Part(
        "Mirrors, by formula",
        "Pixels of 20 000 points at 0.15 to 3 m: the law of reflection on the published surface, "
        "solved by bisection, transcribed and not a foreign program; and points of the surface.",
        _run_mirrors,
    ),
    "discs": Part(
        "Mirrors, drawn by Mitsuba",
        "Discs of 5 to 50 px^2 at 0.15, 0.3, 1 and 3 m, images of 360 px: distances of centroids "
        "in Mitsuba's pictures from those in ours, and the standard error (median) of each. The "
        "mirror is a smooth conductor that Mitsuba traces in float32: a sphere of its own, else a "
        "mesh of 720 x 720 facets with normals of the publication's surface. In the innermost 8 "
        "degrees, of a cone from its apex, the mesh's hub is the limit: its discs are drawn out to "
        "less than a pixel's width, and nothing is required. Mitsuba starts a reflected "
        "ray 9e-5 of its largest coordinate off the surface: up to 0.01 px at 0.15 m on the cone. "
        "Scale: the factor between positions about the centre, as a fraction.",
        _run_discs,
    ),
    "labels": Part(
        "Labels and ranges",
        "Ids and ranges of all pixels of 360 px, in a world of 28 boxes and 8 rectangles, against "
        "a float64 caster that knows these as numbers, with rays of the publications. Where rays "
        "1e-4 px from the centre differ, an edge runs through the centre and either id is right.",
        _run_labels,
    ),
    "boards": Part(
        "The paper's geometry",
        "OpenCV finds corners of chessboards in pictures of ours and calibrates its unified model; "
        "xi and gamma follow from the paper's k = 11.546.",
        _run_boards,
    ),
}


def main(arguments: list[str]) -> int:
    """Run parts, all by default; write the page, and answer with the exit status."""
    missing = [program for program in PROGRAMS if not is_installed(program)]
    if missing:
        print(f"the proof from outside needs {', '.join(missing)}: {INSTALL}")
        return 2
    OUTPUT.mkdir(parents=True, exist_ok=True)
    for name in arguments or PARTS:
        begin = time.perf_counter(), time.process_time()
        results = []
        for result in PARTS[name].run():
            _show(result)
            results.append(asdict(result) if isinstance(result, Finding) else result)
        seconds = time.perf_counter() - begin[0], time.process_time() - begin[1]
        print(f"{name}: {seconds[0]:.0f} s, {seconds[1]:.0f} s of processor time", flush=True)
        record = {"date": f"{datetime.now(UTC):%Y-%m-%d}", "processor_s": seconds[1],
                  "results": results}  # fmt: skip
        (OUTPUT / f"{name}.json").write_text(json.dumps(record))
    records = {
        name: json.loads(path.read_text())
        for name in PARTS
        if (path := OUTPUT / f"{name}.json").exists()
    }
    if len(records) == len(PARTS):
        PAGE.write_text(make_page(records), encoding="utf-8")
    return int(any(not _is_right(r) for one in records.values() for r in one["results"]))


def _show(result: Finding | Noticed) -> None:
    if isinstance(result, Finding):
        mark = "" if result.holds else "  EXCEEDED"
        print(f"{result.subject}, {result.authority}: {result.largest:.1e}{mark}", flush=True)
    elif not result[1]:
        print(f"mutant of 1e-4 not noticed: {result[0]}", flush=True)


def _is_right(result: dict[str, object] | list[object]) -> bool:
    return Finding(**result).holds if isinstance(result, dict) else bool(result[1])  # type: ignore[arg-type]


def make_page(records: dict[str, dict]) -> str:
    """Text of docs/PROOF.md."""
    seen = [r for one in records.values() for r in one["results"] if isinstance(r, list)]
    rows = [r for one in records.values() for r in one["results"] if isinstance(r, dict)]
    noticed, held = sum(bool(r[1]) for r in seen), sum(map(_is_right, rows))
    minutes = sum(one["processor_s"] for one in records.values()) / 60.0
    lines = [
        "# Proof from outside",
        "",
        "What this repository computes, compared with programs that share no code with it. Written "
        "by `make outside`, which installs them (0.7 GB) and repeats everything; it ends with an "
        "error when a difference exceeds its bound.",
        "",
        f"* {held} of {len(rows)} differences are within their bounds.",
        f"* {noticed} of {len(seen)} mutants are noticed: models with one number changed by 1e-4 "
        "of itself, in each model. Pictures notice "
        "the scale; smaller parts, such as a k that is 1e-4 larger (2e-4 px), formulas alone.",
        f"* {minutes:.0f} minutes of processor time, {platform.python_implementation()} "
        f"{platform.python_version()}, {platform.machine()}.",
        "",
        "\"Transcribed\" is a formula that the measurement (`tests/outside`) has from the "
        "publication; every other row is a program with its version.",
    ]  # fmt: skip
    for name, part in PARTS.items():
        lines += [
            "",
            f"## {part.title}",
            "",
            part.text,
            "",
            f"Measured {records[name]['date']}.",
            "",
        ]
        lines += [
            "| what | compared with | number | largest | median | bound | standard error | note |",
            "|---|---|---|---|---|---|---|---|",
        ]
        for row in records[name]["results"]:
            if isinstance(row, dict):
                lines.append(_format_row(Finding(**row)))
    return "\n".join(lines) + "\n"


def _format_row(row: Finding) -> str:
    largest, median, bound = (
        "none" if math.isinf(value) else f"{value:.2g} {row.unit}".strip()
        for value in (row.largest, row.median, row.bound)
    )
    return (
        f"| {row.subject} | {row.authority} | {row.count} | {largest} | {median} | {bound} "
        f"| {row.error} | {row.note} |"
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
