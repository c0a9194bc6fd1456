"""Rules for the files of the page that need no browser."""

from __future__ import annotations

from browser.measured_requirements import MeasuredRequirements
from browser.static_files import STATIC, list_files, panel_scripts
from browser.test_panels import PANEL_TESTS

# 250 KiB.
_MAX_KB = 256.0


def test_files_of_the_page_together_are_small(requirements: MeasuredRequirements) -> None:
    sizes = {path.relative_to(STATIC).as_posix(): path.stat().st_size for path in list_files()}
    total_kb = sum(sizes.values()) / 1000.0
    largest = max(sizes, key=lambda name: sizes[name])
    requirements.check(
        f"all files of the page together at most {_MAX_KB:g} kB",
        f"{total_kb:.0f} kB in {len(sizes)} files, largest {largest} ({sizes[largest] / 1000:.0f})",
        is_met=total_kb <= _MAX_KB and "index.html" in sizes,
    )


def test_panels_are_all_in_a_browser_test() -> None:
    assert set(PANEL_TESTS) == set(panel_scripts())


def test_panel_scripts_all_exist() -> None:
    scripts = panel_scripts()
    assert len(scripts) >= 10
    assert [name for name in scripts.values() if not (STATIC / name).is_file()] == []
