"""The page of a camera with a lens: what it says and offers there, in place of a mirror."""

from __future__ import annotations

import re
from collections.abc import Iterator

import pytest

from browser.camera_pages import CameraPage, open_camera_page
from browser.chromium import Browser
from helpers.configs import FIELD

_LIMIT_S = 20.0


@pytest.fixture(scope="module")
def page(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[CameraPage]:
    """The page of a fish-eye of 220 degrees, which delivers right-handed pictures."""
    folder = tmp_path_factory.mktemp("lens")
    case = "hanging fish-eye"
    with open_camera_page(browser, case, folder, world=FIELD, x_m=-0.7, y_m=0.4) as opened:
        opened.tab.emulate(width=1400, height=3200)
        yield opened


def _text(page: CameraPage, panel: str) -> str:
    return str(page.tab.evaluate(f"document.querySelector('#panel-{panel} .body').innerText"))


def test_accuracy_of_a_lens_compares_samples_without_polygons(page: CameraPage) -> None:
    accuracy = "document.querySelector('#panel-accuracy .body').innerText"
    page.tab.wait_for(f"/at most \\d+/.test({accuracy})", "difference picture", _LIMIT_S)
    text = _text(page, "accuracy")
    assert "rejected" not in text
    assert "per pixel" in text
    selector = "document.querySelector('#accuracy-mirror').checkVisibility()"
    assert page.tab.evaluate(selector) is False


def test_page_of_a_lens_names_no_mirror(page: CameraPage) -> None:
    page.tab.evaluate("catoptra.context.setCursor([1, 1], true)")
    page.tab.wait_for("/outside/.test(document.body.innerText)", "cursor outside", _LIMIT_S)
    for panel in ("omni", "panorama", "perspective", "cursor", "accuracy"):
        assert not re.search("mirror", _text(page, panel), re.IGNORECASE), panel
    page.tab.evaluate("catoptra.context.setCursor(null)")
