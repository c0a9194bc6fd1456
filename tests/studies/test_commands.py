from __future__ import annotations

import pytest

from catoptra_studies.commands import open_progress, print_error, print_line, print_table


def test_line_when_printed_keeps_brackets(capsys: pytest.CaptureFixture[str]) -> None:
    print_line("pip install 'catoptra-studies[server]'")
    assert "catoptra-studies[server]" in capsys.readouterr().out


def test_error_when_printed_goes_to_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    print_error("cost: [red]no.ini[/red]")
    captured = capsys.readouterr()
    assert (captured.out, captured.err) == ("", "cost: [red]no.ini[/red]\n")


def test_table_when_printed_ends_rows_with_yes_or_no(capsys: pytest.CaptureFixture[str]) -> None:
    print_table(("claim", "measured", "confirmed"), [(("a", "1"), True), (("b", "2"), False)])
    printed = capsys.readouterr().out
    assert "yes" in printed
    assert "no" in printed


def test_progress_when_hidden_prints_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    with open_progress(is_visible=False) as progress:
        advance = progress.add_task("frames", 2)
        advance()
        advance()
    assert capsys.readouterr().err == ""


def test_line_when_printed_above_bars_goes_to_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    with open_progress(is_visible=False) as progress:
        progress.print_line("sim: watch the drives at http://[::1]:5080/")
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == "sim: watch the drives at http://[::1]:5080/\n"
