from __future__ import annotations

import json
import math
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_server.cost.document import Document, StepCost, read_document, write_document


def written(document: Document, folder: Path) -> Any:
    write_document(document, folder / "cost.json")
    text = (folder / "cost.json").read_text()
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


def test_document_when_written_and_read_is_the_same(document: Document, tmp_path: Path) -> None:
    written(document, tmp_path)
    assert read_document(tmp_path / "cost.json") == document


def test_schema_has_a_version_and_every_field_of_a_step(document: Document, tmp_path: Path) -> None:
    read = written(document, tmp_path)
    assert read["version"] == 1
    assert set(read) == {
        *("version", "conditions", "steps", "polygons", "frame_rates", "landmarks")
    }
    assert set(read["steps"][0]) == {field.name for field in fields(StepCost)}


def test_numbers_that_json_lacks_are_null_and_come_back(document: Document, tmp_path: Path) -> None:
    assert document.landmarks is not None
    row = replace(document.landmarks.rows[0], bearing_rms_deg=math.nan)
    changed = replace(
        document,
        steps=(replace(document.steps[0], psnr_db=math.inf),),
        landmarks=replace(document.landmarks, rows=(row,)),
    )
    assert written(changed, tmp_path)["steps"][0]["psnr_db"] is None
    read = read_document(tmp_path / "cost.json")
    assert read.steps[0].psnr_db == math.inf
    assert read.landmarks is not None
    assert math.isnan(read.landmarks.rows[0].bearing_rms_deg)


@pytest.mark.parametrize(
    "change",
    [{"version": 2}, {"steps": [{"name": "alone"}]}, {"conditions": None}],
    ids=["another version", "missing fields", "nothing"],
)
def test_document_when_it_is_no_study_is_refused_with_a_remedy(
    document: Document, tmp_path: Path, change: dict[str, Any]
) -> None:
    broken = written(document, tmp_path) | change
    (tmp_path / "cost.json").write_text(json.dumps(broken))
    with pytest.raises(CatoptraError, match="measure anew with catoptra-server cost"):
        read_document(tmp_path / "cost.json")


def test_document_when_it_has_unknown_keys_is_read(document: Document, tmp_path: Path) -> None:
    read = written(document, tmp_path)
    read["steps"][0]["weather"] = "fine"
    (tmp_path / "cost.json").write_text(json.dumps(read))
    assert read_document(tmp_path / "cost.json") == document
