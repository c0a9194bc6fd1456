from __future__ import annotations

from catoptra_studies.reports import Cell, html_table


def test_table_has_a_heading_row_and_escapes_its_cells() -> None:
    table = html_table([Cell("a"), Cell("b", "n")], [[Cell("1 < 2"), Cell("3", "n")]])
    assert table == (
        '<table><tr><th>a</th><th class="n">b</th></tr>'
        '<tr><td>1 &lt; 2</td><td class="n">3</td></tr></table>'
    )
