"""The proof from outside notices every model that is wrong by 1e-4, and says what is missing."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from catoptra_protocol.optics.mirrors import HyperbolicMirror
from outside import run
from outside.findings import MUTATION, Finding, mutants
from outside.labels import cast, make_world
from outside.lenses import LensCase, compare_lens, lens_cases
from outside.mirrors import MirrorCase, compare_mirror, mirror_cases

LENSES, MIRRORS = lens_cases(), mirror_cases()
GOOD = Finding("lens", "formula", 1e-13, 0.0, 1e-9, "px", 1)


def test_every_model_has_a_case() -> None:
    from catoptra_protocol.optics.lenses import LENSES as ALL_LENSES
    from catoptra_protocol.optics.mirrors import MIRRORS as ALL_MIRRORS

    assert {case.name.split(",")[0] for case in LENSES} == set(ALL_LENSES)
    assert {case.name for case in MIRRORS} == set(ALL_MIRRORS)


def test_at_least_eight_lens_models_have_a_foreign_program() -> None:
    assert len({case.name.split(",")[0] for case in LENSES if case.programs}) >= 8


@pytest.mark.parametrize("case", LENSES, ids=lambda case: case.name)
def test_lens_agrees_and_each_mutant_is_noticed(case: LensCase) -> None:
    # OpenCV is a tool of the tests; the other programs are not.
    programs = {name: each for name, each in case.programs.items() if name.startswith("opencv")}
    assert all(finding.holds for finding in compare_lens(replace(case, programs=programs)))
    numbers = list(mutants(case.camera))
    assert len(numbers) >= 3
    for name, camera in numbers:
        assert any(not finding.holds for finding in compare_lens(case, camera)), name


@pytest.mark.parametrize("case", MIRRORS, ids=lambda case: case.name)
def test_mirror_agrees_and_each_mutant_is_noticed(case: MirrorCase) -> None:
    assert all(finding.holds for finding in compare_mirror(case, case.camera))
    numbers = list(mutants(case.camera))
    assert len(numbers) >= 4
    for name, camera in numbers:
        assert any(not finding.holds for finding in compare_mirror(case, camera)), name


def test_caster_meets_the_near_side_of_a_box() -> None:
    box = make_world().items[0]
    place = box.world_from_item.translation
    distance = float(np.linalg.norm(place))
    half = 0.5 * np.array(box.shape.size_m)  # type: ignore[union-attr]
    along = np.abs(box.world_from_item.rotation.T @ place / distance)
    world = replace(make_world(), items=(box,))
    ids, ranges = cast(world, np.zeros((1, 3)), (place / distance)[None])
    assert ids[0] == 1
    assert ranges[0] == pytest.approx(distance - (half / along).min(), rel=1e-12)


@pytest.mark.parametrize(
    ("results", "status"),
    [
        ([GOOD, ("lens: k1", True)], 0),
        ([replace(GOOD, largest=MUTATION)], 1),
        ([replace(GOOD, largest=float("nan"))], 1),
        ([GOOD, ("lens: k1", False)], 1),
    ],
)
def test_exit_status_and_page_state_what_was_found(
    results: list[Finding | tuple[str, bool]], status: int, tmp_path, monkeypatch
) -> None:
    def part() -> Iterator[Finding | tuple[str, bool]]:
        yield from results

    monkeypatch.setattr(run, "PROGRAMS", ())
    monkeypatch.setattr(run, "PAGE", tmp_path / "PROOF.md")
    monkeypatch.setattr(run, "PARTS", {"lenses": run.Part("Lenses", "All.", part)})
    assert run.main([]) == status
    page = (tmp_path / "PROOF.md").read_text()
    assert f"| lens | formula | 1 | {results[0].largest:.2g} px" in page  # type: ignore[union-attr]


def test_source_that_is_wrong_by_1e_4_ends_with_1_and_names_the_model(monkeypatch, capsys) -> None:
    exact = HyperbolicMirror.s.fget
    monkeypatch.setattr(HyperbolicMirror, "s", property(lambda m: exact(m) * (1.0 + MUTATION)))

    def part() -> Iterator[Finding]:
        for case in MIRRORS[:2]:
            yield from compare_mirror(case)

    monkeypatch.setattr(run, "PROGRAMS", ())
    monkeypatch.setattr(run, "PARTS", {"mirrors": run.Part("Mirrors", "Two.", part)})
    assert run.main(["mirrors"]) == 1
    lines = capsys.readouterr().out.splitlines()
    exceeded = {line.partition(",")[0] for line in lines if line.endswith("EXCEEDED")}
    assert exceeded == {"hyperbolic"}


def test_without_mitsuba_it_says_what_to_install(monkeypatch, capsys) -> None:
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    assert run.main([]) == 2
    (line,) = capsys.readouterr().out.splitlines()
    assert "mitsuba" in line
    assert "catoptra-server[outside]" in line
