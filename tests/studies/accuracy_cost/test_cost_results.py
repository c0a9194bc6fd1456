from __future__ import annotations

import json
import math
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_studies.accuracy_cost.cost_results import (
    CostResults,
    LevelCost,
    read_cost_results,
    write_cost_results,
)


def written(document: CostResults, folder: Path) -> Any:
    write_cost_results(document, folder / "cost.json")
    text = (folder / "cost.json").read_text()
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


def test_document_when_written_and_read_is_the_same(document: CostResults, tmp_path: Path) -> None:
    written(document, tmp_path)
    assert read_cost_results(tmp_path / "cost.json") == document


def test_schema_has_a_version_and_every_field_of_a_step(
    document: CostResults, tmp_path: Path
) -> None:
    read = written(document, tmp_path)
    assert read["version"] == 1
    assert set(read) == {
        *("version", "conditions", "steps", "polygons", "frame_rates", "landmarks")
    }
    assert set(read["steps"][0]) == {field.name for field in fields(LevelCost)}


def test_numbers_that_json_lacks_are_null_and_come_back(
    document: CostResults, tmp_path: Path
) -> None:
    assert document.localization is not None
    row = replace(document.localization.rows[0], bearing_rms_deg=math.nan)
    changed = replace(
        document,
        levels=(replace(document.levels[0], psnr_db=math.inf),),
        localization=replace(document.localization, rows=(row,)),
    )
    assert written(changed, tmp_path)["steps"][0]["psnr_db"] is None
    read = read_cost_results(tmp_path / "cost.json")
    assert read.levels[0].psnr_db == math.inf
    assert read.localization is not None
    assert math.isnan(read.localization.rows[0].bearing_rms_deg)


@pytest.mark.parametrize(
    "change",
    [{"version": 2}, {"steps": [{"name": "alone"}]}, {"conditions": None}],
    ids=["another version", "missing fields", "nothing"],
)
def test_document_when_it_is_no_study_is_refused_with_a_remedy(
    document: CostResults, tmp_path: Path, change: dict[str, Any]
) -> None:
    broken = written(document, tmp_path) | change
    (tmp_path / "cost.json").write_text(json.dumps(broken))
    with pytest.raises(CatoptraError, match="measure anew with catoptra-server cost"):
        read_cost_results(tmp_path / "cost.json")


def test_document_when_it_has_unknown_keys_is_read(document: CostResults, tmp_path: Path) -> None:
    read = written(document, tmp_path)
    read["steps"][0]["weather"] = "fine"
    (tmp_path / "cost.json").write_text(json.dumps(read))
    assert read_cost_results(tmp_path / "cost.json") == document
