"""The camera's pictures as others leave them: read, waited for, left out."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from catoptra_client.experiment.camera_pictures import Drawing, camera_pictures
from catoptra_client.experiment.session import Plan
from catoptra_protocol.errors import CatoptraError

DRAWN = {
    "figures": [
        {"file": "a.png", "title": "Faces", "figure": "Figure 5", "caption": "five", "alt": "f"}
    ],
    "numbers": {"eq2_px": 0.81},
}


@pytest.fixture
def plan(tmp_path: Path) -> Plan:
    return Plan(
        None, tmp_path, setups=(), runs=1, seed=0, training_frames=1, servers={}, patience_s=0.0
    )


def test_pictures_when_drawn_elsewhere_are_read(plan: Plan) -> None:
    (plan.output / "figures.json").write_text(json.dumps(DRAWN))
    pictures, numbers = camera_pictures(plan, Drawing.ELSEWHERE)
    assert [(p.file, p.title) for p in pictures] == [("a.png", "Faces (the paper's Figure 5)")]
    assert numbers == {"eq2_px": 0.81}


def test_pictures_when_nobody_draws_them_are_missed_with_a_remedy(plan: Plan) -> None:
    with pytest.raises(CatoptraError, match="--pictures nobody"):
        camera_pictures(plan, Drawing.ELSEWHERE)


def test_pictures_when_left_out_are_none(plan: Plan) -> None:
    assert camera_pictures(plan, Drawing.NOBODY) == ([], {})


def test_pictures_when_they_cannot_be_drawn_here_are_an_error(plan: Plan, tmp_path: Path) -> None:
    with pytest.raises(CatoptraError, match="could not be drawn"):
        camera_pictures(replace(plan, configs=tmp_path), Drawing.HERE)
