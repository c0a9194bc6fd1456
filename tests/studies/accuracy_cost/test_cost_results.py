from __future__ import annotations

import itertools
import json
import math
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest

from catoptra_protocol.errors import CatoptraError
from catoptra_studies.accuracy_cost.cost_results import (
    FORMAT_VERSION,
    CostResults,
    LevelCost,
    pareto_front,
    read_cost_results,
    write_cost_results,
)


def write_and_load(results: CostResults, folder: Path) -> Any:
    write_cost_results(results, folder / "cost.json")
    text = (folder / "cost.json").read_text()
    return json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is no JSON"))


def test_document_when_written_and_read_is_the_same(results: CostResults, tmp_path: Path) -> None:
    write_and_load(results, tmp_path)
    assert read_cost_results(tmp_path / "cost.json") == results


def test_json_when_written_has_a_version_and_every_field_of_a_level(
    results: CostResults, tmp_path: Path
) -> None:
    read = write_and_load(results, tmp_path)
    assert read["version"] == FORMAT_VERSION
    assert set(read) == {
        *("version", "conditions", "levels", "polygon_rows", "frame_rates", "localization")
    }
    assert set(read["levels"][0]) == {field.name for field in fields(LevelCost)}


def test_numbers_when_json_lacks_them_are_null_and_return(
    results: CostResults, tmp_path: Path
) -> None:
    assert results.localization is not None
    row = replace(results.localization.rows[0], bearing_rms_deg=math.nan)
    changed = replace(
        results,
        levels=(replace(results.levels[0], psnr_db=math.inf),),
        localization=replace(results.localization, rows=(row,)),
    )
    assert write_and_load(changed, tmp_path)["levels"][0]["psnr_db"] is None
    read = read_cost_results(tmp_path / "cost.json")
    assert read.levels[0].psnr_db == math.inf
    assert read.localization is not None
    assert math.isnan(read.localization.rows[0].bearing_rms_deg)


@pytest.mark.parametrize(
    "change",
    [{"version": 1}, {"levels": [{"name": "alone"}]}, {"conditions": None}],
    ids=["another version", "missing fields", "nothing"],
)
def test_document_when_it_is_no_study_is_refused_with_a_remedy(
    results: CostResults, tmp_path: Path, change: dict[str, Any]
) -> None:
    broken = write_and_load(results, tmp_path) | change
    (tmp_path / "cost.json").write_text(json.dumps(broken))
    with pytest.raises(CatoptraError, match="measure again with catoptra-studies cost"):
        read_cost_results(tmp_path / "cost.json")


def test_document_when_it_has_unknown_keys_is_read(results: CostResults, tmp_path: Path) -> None:
    read = write_and_load(results, tmp_path)
    read["levels"][0]["weather"] = "fine"
    (tmp_path / "cost.json").write_text(json.dumps(read))
    assert read_cost_results(tmp_path / "cost.json") == results


POINTS = ((1.0, 9.0), (2.0, 9.0), (3.0, 4.0), (2.5, 6.0), (4.0, 5.0), (5.0, 3.9))


@pytest.mark.parametrize(
    ("points", "min_gain", "front"),
    [
        (POINTS, 0.0, (0, 3, 2, 5)),
        (POINTS, 0.05, (0, 3, 2)),
        ([(1.0, 1.0), (1.0, 1.0)], 0.0, (0,)),
        ([], 0.0, ()),
    ],
    ids=["from fast to exact", "a least gain", "the first of equals", "nothing"],
)
def test_front_has_the_points_that_no_other_beats(points, min_gain, front) -> None:
    assert pareto_front(points, min_gain=min_gain) == front


@pytest.mark.parametrize("order", list(itertools.permutations(range(4))))
def test_front_does_not_depend_on_the_order(order: tuple[int, ...]) -> None:
    four = POINTS[:4]
    shuffled = [four[index] for index in order]
    assert {shuffled[index] for index in pareto_front(shuffled)} == {four[0], four[2], four[3]}
