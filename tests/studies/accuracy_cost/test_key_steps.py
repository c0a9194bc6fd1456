"""cost.json on the client's side: key steps out of it, landmarks into it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_studies.accuracy_cost.key_levels import (
    read_cost_json,
    select_key_levels,
    write_localization,
    write_robot_file,
)


def row(name: str, rmse: float, *, is_key: bool) -> dict[str, Any]:
    lines = "[Catoptra.OmniCaptureCamera]\nSamples=3\n"
    return {
        "name": name,
        "renderer": "trace",
        "robot_lines": lines,
        "rmse": rmse,
        "is_key": is_key,
        "ms": 5.0,
    }


STUDY: dict[str, Any] = {
    "version": 1,
    "steps": [
        row("exact", 1.0, is_key=True),
        row("other", 2.0, is_key=False),
        row("coarse", 9.0, is_key=True),
    ],
}


def test_key_steps_go_from_coarse_to_exact() -> None:
    assert [step.name for step in select_key_levels(STUDY)] == ["coarse", "exact"]


def test_study_when_a_field_is_missing_is_refused() -> None:
    with pytest.raises(CatoptraError, match="another version"):
        select_key_levels({"steps": [{"is_key": True}]})


@pytest.mark.parametrize("text", [None, "no json"], ids=["missing", "broken"])
def test_study_when_there_is_none_is_refused_with_a_remedy(
    tmp_path: Path, text: str | None
) -> None:
    path = tmp_path / "cost.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(CatoptraError, match="let catoptra-server cost measure first"):
        read_cost_json(path)


def test_robot_file_is_based_on_another_and_draws_as_the_step_says(tmp_path: Path) -> None:
    write_robot_file(select_key_levels(STUDY)[0], tmp_path / "base.ini", tmp_path / "robot.ini")
    assert (tmp_path / "robot.ini").read_text() == (
        f"[Configuration]\nBasedOn={tmp_path.resolve() / 'base.ini'}\n"
        "[Catoptra.OmniCaptureCamera]\nSamples=3\n"
    )


def test_landmarks_are_added_and_all_else_stays(tmp_path: Path) -> None:
    path = tmp_path / "cost.json"
    write_localization(STUDY, {"runs": 5, "rows": []}, path)
    assert json.loads(path.read_text()) == {**STUDY, "landmarks": {"runs": 5, "rows": []}}
