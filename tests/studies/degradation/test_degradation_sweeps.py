"""The table of ladders, and the robot files that it stands for."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_studies.degradation.degradation_sweeps import (
    SWEEPS,
    DegradationLevel,
    DegradationSweep,
    clean_robot_ini,
    degraded_robot_ini,
)

LADDER = DegradationSweep(
    "Two words",
    "w",
    "u",
    (DegradationLevel("1", "B=2|C=3"),),
    ini_keys="A=1",
    base_robot="base.ini",
)


def test_slugs_when_of_the_table_are_different() -> None:
    assert len({ladder.slug for ladder in SWEEPS}) == len(SWEEPS)


@pytest.mark.parametrize("ladder", SWEEPS, ids=lambda ladder: ladder.slug)
def test_rungs_when_of_one_ladder_have_labels_and_keys_of_their_own(
    ladder: DegradationSweep,
) -> None:
    assert len({rung.label for rung in ladder.levels}) == len(ladder.levels) >= 3
    assert len({rung.ini_keys for rung in ladder.levels}) == len(ladder.levels)
    assert "clean" not in {rung.label for rung in ladder.levels}


def test_slug_is_fit_for_a_file_name() -> None:
    assert LADDER.slug == "two_words"


def test_robot_file_says_what_ladder_and_rung_say(tmp_path: Path) -> None:
    lines = degraded_robot_ini(LADDER, LADDER.levels[0], tmp_path).splitlines()
    assert lines[1] == f"BasedOn={tmp_path.resolve() / 'base.ini'}"
    camera = lines.index("[Catoptra.OmniCaptureCamera]")
    assert lines[camera + 1 :] == ["Samples=1", "A=1", "B=2", "C=3"]


def test_robot_file_when_clean_asks_for_no_effect(tmp_path: Path) -> None:
    assert clean_robot_ini(tmp_path).endswith("[Catoptra.OmniCaptureCamera]\nSamples=1\n")


def test_robot_file_when_of_any_ladder_has_the_odometry_of_the_sim_robot() -> None:
    robots = Path(__file__).parents[4] / "configs" / "robots"
    sim = (robots / "p2at_omni_sim.ini").read_text(encoding="utf-8")
    said = {line.partition(";")[0].strip() for line in sim.splitlines() if "=" in line}
    odometry = {line for line in said if not line.startswith("BasedOn")}
    assert odometry
    assert odometry <= set(degraded_robot_ini(LADDER, LADDER.levels[0], robots).splitlines())
