"""Reference scripts: each writes exactly the cases in the catalogue."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest
from mpmath import mp

from stability import catalogue
from stability.references import writing

SCRIPTS = [
    path.stem
    for path in sorted(Path(writing.__file__).parent.glob("*.py"))
    if '__name__ == "__main__"' in path.read_text(encoding="utf-8")
]


@pytest.mark.parametrize("script", SCRIPTS)
@pytest.mark.filterwarnings("ignore:.*found in sys.modules:RuntimeWarning")  # run anew, on purpose
def test_script_when_run_again_writes_the_same_cases(script, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(writing, "CASES", tmp_path)
    with mp.workdps(mp.dps):  # the scripts set their own for good
        runpy.run_module(f"stability.references.{script}", run_name="__main__")
    written = sorted(path.relative_to(tmp_path) for path in tmp_path.rglob("*.json"))
    assert written
    for name in written:
        assert (tmp_path / name).read_text() == (catalogue.CASES / name).read_text()


def test_every_formula_is_named_in_a_script() -> None:
    sources = "".join(
        path.read_text(encoding="utf-8") for path in Path(writing.__file__).parent.glob("*.py")
    )
    formulas = {path.stem for path in catalogue.CASES.rglob("*.json")}
    assert formulas
    assert [name for name in sorted(formulas) if f'"{name}"' not in sources] == []
