"""The table of sweeps, and the robot files of their levels."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_studies.degradation.degradation_sweeps import (
    SWEEPS,
    DegradationSweep,
    clean_robot_ini,
    degraded_robot_ini,
)

SWEEP = DegradationSweep(
    "Two words", "w", "u", {"1": "B=2|C=3"}, ini_keys="A=1", base_robot="base.ini"
)


def test_slugs_of_the_table_are_unique() -> None:
    assert len({sweep.slug for sweep in SWEEPS}) == len(SWEEPS)


@pytest.mark.parametrize("sweep", SWEEPS, ids=lambda sweep: sweep.slug)
def test_levels_of_one_sweep_have_unique_keys(sweep: DegradationSweep) -> None:
    assert len(set(sweep.levels.values())) == len(sweep.levels) >= 3
    assert "clean" not in sweep.levels


def test_slug_is_fit_for_a_file_name() -> None:
    assert SWEEP.slug == "two_words"


def test_robot_file_has_the_keys_of_sweep_and_level(tmp_path: Path) -> None:
    lines = degraded_robot_ini(SWEEP, SWEEP.levels["1"], tmp_path).splitlines()
    assert lines[1] == f"BasedOn={tmp_path.resolve() / 'base.ini'}"
    camera = lines.index("[Catoptra.OmniCaptureCamera]")
    assert lines[camera + 1 :] == ["Samples=1", "A=1", "B=2", "C=3"]


def test_robot_file_when_clean_has_no_effect(tmp_path: Path) -> None:
    assert clean_robot_ini(tmp_path).endswith("[Catoptra.OmniCaptureCamera]\nSamples=1\n")


def test_robot_file_of_any_sweep_has_the_odometry_of_the_sim_robot() -> None:
    robots = Path(__file__).parents[3] / "configs" / "robots"
    sim = (robots / "p2at_omni_sim.ini").read_text(encoding="utf-8")
    entries = {line.partition(";")[0].strip() for line in sim.splitlines() if "=" in line}
    odometry = {line for line in entries if not line.startswith("BasedOn")}
    assert odometry
    assert odometry <= set(degraded_robot_ini(SWEEP, SWEEP.levels["1"], robots).splitlines())
