"""Contrast and names by axe-core, and the walk of the Tab key through all controls."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from browser.axe import VERSION, find_violations, load_axe
from browser.chromium import Browser
from browser.live_server import OwnedServer
from browser.measured_requirements import MeasuredRequirements
from browser.tab import Tab, open_tab

_MAX_STEPS = 400
# Number of each control in the order of the Tab key, and what a person would call it.
_FOCUSED = """() => {
  const element = document.activeElement;
  return [instruments.listControls().indexOf(element), instruments.describe(element)];
}"""


@pytest.fixture(scope="module")
def page(browser: Browser, full_live: OwnedServer) -> Iterator[Tab]:
    """The page of a robot with everything."""
    with open_tab(browser, new_window=True) as tab:
        tab.emulate(width=1400, height=3200)
        tab.open(full_live.live.url)
        tab.wait_for("instruments.frames.length >= 5", "5 pictures", 20.0)
        yield tab


@pytest.mark.parametrize("colour_scheme", ["light", "dark"])
@pytest.mark.parametrize(("width", "is_phone"), [(1400, False), (390, True)])
def test_page_has_no_violations_of_wcag(
    page: Tab,
    output: Path,
    requirements: MeasuredRequirements,
    colour_scheme: str,
    width: int,
    is_phone: bool,
) -> None:
    page.emulate(width=width, height=3200, is_phone=is_phone, colour_scheme=colour_scheme)
    page.wait_for(f"matchMedia('(prefers-color-scheme: {colour_scheme})').matches", "scheme", 5.0)
    # Colours change over a moment; contrast is that of the end.
    page.wait_for("document.getAnimations().length === 0", "end of all transitions", 5.0)
    violations = find_violations(page, load_axe(output))
    requirements.check(
        f"axe-core {VERSION}: no violation of WCAG 2.1 A and AA ({colour_scheme}, {width} px)",
        f"{len(violations)} {violations[:5] or ''}",
        is_met=not violations,
    )


def test_tab_key_reaches_every_control(page: Tab, requirements: MeasuredRequirements) -> None:
    page.emulate(width=1400, height=3200)
    page.activate()
    names = page.evaluate("instruments.listControls().map(instruments.describe)")
    page.evaluate("document.activeElement.blur(); window.getSelection().removeAllRanges()")
    reached = set()
    for _ in range(_MAX_STEPS):
        page.press("Tab")
        index, _ = page.invoke(_FOCUSED)
        if index in reached:
            break
        if index >= 0:
            reached.add(index)
    missing = [name for index, name in enumerate(names) if index not in reached]
    requirements.check(
        "the Tab key reaches every control",
        f"{len(reached)} of {len(names)} {missing or ''}",
        is_met=len(names) > 20 and not missing,
    )


def test_focus_is_visible_on_every_control(page: Tab) -> None:
    page.emulate(width=1400, height=3200)
    hidden = page.evaluate(
        """(() => instruments.listControls().filter((element) => {
          element.focus({ focusVisible: true });
          const style = getComputedStyle(element);
          return style.outlineStyle === "none" && style.boxShadow === "none";
        }).map(instruments.describe))()"""
    )
    assert hidden == []
