from __future__ import annotations

from pathlib import Path

import cv2
import pytest

from catoptra_server.effects import EFFECT_TYPES
from catoptra_studies.effects.effect_cases import EFFECT_CASES
from catoptra_studies.effects.effect_pages import write_effect_pages

# Those of worlds with a sky and baked light are shown in docs/EFFECTS.md.
NAMES = [name for name in EFFECT_TYPES if name not in ("BakedLight", "SkyRadiance")]


def test_cases_when_listed_have_one_of_every_effect_in_optical_order() -> None:
    assert [case.effect.name for case in EFFECT_CASES] == NAMES


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("pages") / "effects"
    write_effect_pages(output)
    return output


@pytest.mark.parametrize("name", NAMES)
def test_page_shows_an_image_without_and_another_with_the_effect(folder: Path, name: str) -> None:
    page = cv2.imread(str(folder / f"{name}.png"))
    assert page.shape == (660, 1520, 3)
    without, with_it = page[56:536, 20:500], page[56:536, 520:1000]
    assert without.std() > 10.0
    assert (without != with_it).mean() > 0.01


def test_explanations_have_a_scene_that_needs_each_effect_and_one_that_does_not(
    folder: Path,
) -> None:
    explanations = (folder / "explanations.txt").read_text(encoding="utf-8").split("\n\n")
    assert len(explanations) == len(NAMES)
    for required, negligible in (pair.strip().splitlines() for pair in explanations):
        assert ": on, " in required
        assert ": off, " in negligible
