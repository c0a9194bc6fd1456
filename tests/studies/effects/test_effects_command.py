"""The command line of `catoptra-studies effects`; its two parts are tested beside this file."""

from __future__ import annotations

from pathlib import Path

import pytest

from catoptra_studies.effects import decision_experiment, effects_command
from catoptra_studies.reports import replace_block
from helpers.configs import REPOSITORY
from studies.degradation.test_degradation_report import RESULT
from studies.effects.test_decision_report import OFF, ON


@pytest.mark.parametrize("part", [["--sweep", "noise"], ["--only", "pages"]])
def test_page_gets_no_table_of_a_part(
    part: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        effects_command.main([*part, "--out", str(tmp_path), "--page", "docs/EFFECTS.md"])
    assert "leave out --sweep and --only pages" in capsys.readouterr().err


def test_page_when_named_gets_the_table_of_the_sweeps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = tmp_path / "page.md"
    page.write_text("a\n<!-- sweeps: begin -->\nformer\n<!-- sweeps: end -->\nb\n")
    monkeypatch.setattr(effects_command, "run_degradation_study", lambda *_, **__: (RESULT,))
    monkeypatch.setattr(effects_command, "write_degradation_results", lambda *_: None)
    arguments = ("--only", "sweeps", "--out", str(tmp_path), "--configs", "configs")
    monkeypatch.chdir(REPOSITORY)
    assert effects_command.main([*arguments, "--page", str(page)]) == 0
    assert "former" not in page.read_text()
    assert "seeds 0 to 1" in page.read_text()


def test_page_when_named_gets_the_table_of_the_decisions(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = tmp_path / "page.md"
    page.write_text("a\n<!-- decisions: begin -->\nformer\n<!-- decisions: end -->\nb\n")
    monkeypatch.setattr(decision_experiment, "run_decision_study", lambda *_, **__: [ON, OFF])
    arguments = ("--only", "decisions", "--out", str(tmp_path), "--page", str(page))
    # Two situations fall short of the criteria, and the page says so.
    assert effects_command.main(arguments) == 1
    assert "former" not in page.read_text()
    assert "situations of seed 0:" in page.read_text()
    assert "* falls short:" in page.read_text()


@pytest.mark.parametrize("block", ["decisions", "sweeps"])
def test_effects_page_has_the_marks_of_the_tables(block: str, tmp_path: Path) -> None:
    copy = tmp_path / "EFFECTS.md"
    copy.write_text((REPOSITORY / "docs/EFFECTS.md").read_text(encoding="utf-8"))
    replace_block(copy, block, "new")
    assert "-->\nnew\n<!--" in copy.read_text()
