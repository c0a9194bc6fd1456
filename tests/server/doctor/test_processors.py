"""Processors, and the limits of containers."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_server.commands.doctor.machine import Level, check_processors, read_cpu_limit


@pytest.mark.parametrize(
    ("text", "limit"),
    [("200000 100000", 2.0), ("50000 100000", 0.5), ("max 100000", None), ("", None)],
)
def test_limit_when_a_container_sets_one_is_read(
    tmp_path: Path, text: str, limit: float | None
) -> None:
    (tmp_path / "cpu.max").write_text(text)
    assert read_cpu_limit(tmp_path / "cpu.max") == limit


def test_limit_when_there_is_no_file_is_none(tmp_path: Path) -> None:
    assert read_cpu_limit(tmp_path / "none") is None


def test_threads_when_more_than_the_limit_are_a_warning(tmp_path: Path) -> None:
    (tmp_path / "cpu.max").write_text("150000 100000")
    (found,) = check_processors(8, tmp_path / "cpu.max")
    assert (found.level, found.remedy) == (Level.WARNING, "--threads 1")


def test_threads_when_unlimited_are_no_problem(tmp_path: Path) -> None:
    (found,) = check_processors(8, tmp_path / "none")
    assert (found.level, found.message) == (Level.OK, "8 processors")
