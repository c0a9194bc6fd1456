"""The page of a camera with a lens: what it says in place of a mirror, and either hand of pictures.

The lens delivers right-handed pictures, the page turns them round on request.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

import numpy as np
import pytest

from browser.camera_pages import CameraPage, open_camera_page
from browser.chromium import Browser
from helpers.configs import FIELD

_LIMIT_S = 20.0


@pytest.fixture(scope="module")
def page(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[CameraPage]:
    """The page of a fish-eye of 220 degrees, all panels in view."""
    folder = tmp_path_factory.mktemp("lens")
    case = "hanging fish-eye"
    with open_camera_page(browser, case, folder, world=FIELD, x_m=-0.7, y_m=0.4) as opened:
        opened.tab.emulate(width=1400, height=3200)
        yield opened


def _text(page: CameraPage, panel: str) -> str:
    return str(page.tab.evaluate(f"document.querySelector('#panel-{panel} .body').innerText"))


def test_accuracy_of_a_lens_compares_samples_without_polygons(page: CameraPage) -> None:
    tab = page.tab
    tab.invoke(
        """() => {
          const slider = document.querySelector("#cost-slider");
          slider.value = slider.max;
          slider.dispatchEvent(new Event("input"));
          document.querySelector("#body-cost button").click();
        }"""
    )
    difference = "document.querySelector('#panel-omni .difference').innerText"
    tab.wait_for(f"/at most \\d+/.test({difference})", "difference picture", _LIMIT_S)
    text = tab.evaluate("document.querySelector('#panel-cost').innerText")
    assert "1 \u00d7 1 samples" in text
    assert "polygons" not in text
    assert "per pixel" in _text(page, "accuracy")
    for button in ("Show the error", "Reset"):
        tab.evaluate(
            "[...document.querySelectorAll('#body-cost button')]"
            f".find((one) => one.innerText === '{button}').click()"
        )


def test_page_of_a_lens_names_no_mirror(page: CameraPage) -> None:
    page.tab.evaluate("catoptra.context.setCursor([1, 1], true)")
    page.tab.wait_for("/outside/.test(document.body.innerText)", "cursor outside", _LIMIT_S)
    for panel in ("omni", "panorama", "perspective", "cost", "accuracy"):
        assert not re.search("mirror", _text(page, panel), re.IGNORECASE), panel
    page.tab.evaluate("catoptra.context.setCursor(null)")


# A landmark by the server and by the page, and the cursor, in the present hand.
_READ_TURNED = """async () => {
  const { context } = catoptra;
  const [landmark] = context.landmarks.filter(({ pixel, visible }) => pixel && visible);
  const views = await import("/static/views/directions.js");
  const mark = views.landmarkDirections(context).find(({ name }) => name === landmark.name);
  return {
    hand: context.table.picture,
    frame: context.frame.header.camera_model.Picture,
    served: landmark.pixel,
    marked: views.pixelFromDirection(context, mark.direction),
    cursor: context.cursor.pixel,
    width_px: context.table.width_px,
  };
}"""


def test_turned_picture_has_its_marks_and_its_cursor_turned(page: CameraPage) -> None:
    tab = page.tab
    tab.wait_for("catoptra.context.landmarks.some((l) => l.visible)", "landmarks", _LIMIT_S)
    panel = "document.querySelector('#cursor-card').innerText"
    tab.evaluate("catoptra.context.setCursor([450, 100], true)")
    tab.wait_for(f"/object\\s+\\w+/.test({panel})", "object under the cursor", _LIMIT_S)
    names = ("azimuth", "elevation", "object")
    before = {name: _value(page, name) for name in names}
    own = tab.invoke(_READ_TURNED)
    assert own["hand"] == own["frame"] == "flipped"
    _turn(page, "mirrored")
    turned = tab.invoke(_READ_TURNED)
    assert turned["frame"] == "mirrored"
    width = own["width_px"]
    assert turned["cursor"] == pytest.approx([width - 450.0, 100.0])
    # The server's pixels are those of the camera's own hand.
    assert own["marked"] == pytest.approx(own["served"], abs=1e-3)
    u, v = own["served"]
    assert turned["marked"] == pytest.approx([width - u, v], abs=1e-3)
    # Moved, so that the server is asked anew: about the same thing.
    tab.evaluate(f"catoptra.context.setCursor([{width - 450.25}, 100], true)")
    tab.wait_for(f"!({panel}).includes({before['azimuth']!r})", "new azimuth", _LIMIT_S)
    tab.wait_for(f"({panel}).includes({before['object']!r})", "the same object", _LIMIT_S)
    assert _degrees(page, "azimuth") == pytest.approx(float(before["azimuth"][:-1]), abs=0.2)
    assert _degrees(page, "elevation") == pytest.approx(float(before["elevation"][:-1]), abs=0.2)
    _turn(page, "flipped")
    tab.evaluate("catoptra.context.setCursor(null)")


def test_panorama_of_a_turned_picture_is_the_same(page: CameraPage) -> None:
    _, own, _ = page.read_view("panorama", columns=480)
    _turn(page, "mirrored")
    frame, turned, reply = page.read_view("panorama", columns=480)
    assert reply["picture"] == "mirrored"
    assert np.abs(frame[:, ::-1].astype(int) - page.read_frame().astype(int)).max() == 0
    difference = np.abs(own.astype(int) - turned.astype(int)).max(axis=-1)
    assert np.mean(difference <= 2) >= 0.995
    _turn(page, "flipped")


def _turn(page: CameraPage, hand: str) -> None:
    """Press the button that turns the picture round, and wait for a picture of that hand."""
    page.tab.click("#panel-omni button[aria-label^='Turn the picture']")
    shown = "catoptra.context.frame?.header.camera_model.Picture"
    page.tab.wait_for(f"{shown} === '{hand}'", f"{hand} picture", _LIMIT_S)


def _value(page: CameraPage, name: str) -> str:
    row = f"document.evaluate('//dt[.=\"{name}\"]/following-sibling::dd[1]', document)"
    return str(page.tab.evaluate(f"{row}.iterateNext().textContent"))


def _degrees(page: CameraPage, name: str) -> float:
    return float(_value(page, name).removesuffix("°"))
