"""`python -m stability.report out/stability`: hard cases, mutants beside the product, the filter.

Writes report.html: one file without scripts or external resources. Returns 1 if a case fails.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterable, Sequence
from datetime import date
from html import escape
from itertools import groupby
from pathlib import Path
from string import Template

from catoptra_studies.reports import markdown_table, replace_block
from stability.charts import line_chart
from stability.consistency import RUNS, STEPS, Consistency, consistency
from stability.measuring import MutantResult, Outcome, evaluate_group, evaluate_mutants, groups

PAGE = Path(__file__).with_name("report.html")
# The scale of the mutants' errors runs from 1e-20 to 10.
_LOWEST, _HIGHEST = -20.0, 1.0
_DIGITS = 22


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the report; 1 if a case fails."""
    parser = argparse.ArgumentParser(prog="stability.report", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--page", type=Path, help="file whose block stability gets the counts")
    parsed = parser.parse_args(arguments)
    folder, mutant = parsed.folder, list(evaluate_mutants())
    of_group = {group: evaluate_group(group) for group in groups()}
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "report.html"
    path.write_text(page(of_group, mutant, consistency()), encoding="utf-8")
    if parsed.page:
        counts = [[text, str(number)] for number, text in _count(of_group, mutant)]
        table = markdown_table(("formulas against 50 digits", "number"), counts)
        replace_block(parsed.page, "stability", f"{date.today()}:\n\n{table}")
    failing = [o for of in of_group.values() for o in of if o.error_fraction > 1.0]
    for outcome in failing:
        print(f"{outcome.case}: {outcome.got}, but {outcome.reference or outcome.case.expect}")
    print(f"{sum(map(len, of_group.values()))} cases, {len(failing)} fail: {path}")
    return 1 if failing else 0


def page(
    of_group: dict[str, list[Outcome]], mutant: list[MutantResult], filters: Iterable[Consistency]
) -> str:
    """Report as HTML."""
    return Template(PAGE.read_text(encoding="utf-8")).substitute(
        tiles=_tiles(of_group, mutant),
        worst="".join(_worst_row(group, of) for group, of in of_group.items()),
        mutant="".join(map(_mutant_row, sorted(mutant, key=lambda form: form.mutation.group))),
        runs=RUNS,
        steps=STEPS,
        charts="".join(map(_chart, filters)),
        all="".join(_group(group, of) for group, of in of_group.items()),
    )


def _tiles(of_group: dict[str, list[Outcome]], mutant: list[MutantResult]) -> str:
    counts = _count(of_group, mutant)
    return "".join(f'<div class="tile"><b>{n}</b><span>{text}</span></div>' for n, text in counts)


def _count(of_group: dict[str, list[Outcome]], mutant: list[MutantResult]) -> list[tuple[int, str]]:
    every = [outcome for of in of_group.values() for outcome in of]
    double = [outcome for outcome in every if outcome.case.float_type == "float64"]
    return [
        (len(double), "hard cases in float64"),
        (len(every) - len(double), "of them in float32 too"),
        (len({(o.case.group, o.case.formula) for o in every}), f"formulas, {len(of_group)} groups"),
        (sum(outcome.error_fraction > 1.0 for outcome in every), "cases that fail"),
        (len(mutant), "mutants, all detected"),
    ]


def _worst_row(group: str, of: list[Outcome]) -> str:
    worst = max(of, key=lambda outcome: outcome.error_fraction)
    case = worst.case
    return (
        f"<tr><td><b>{escape(group)}</b><br><span class=said>{len(of)} cases</span></td>"
        f"<td>{escape(case.name)}<br><code>{escape(case.formula)}</code></td>"
        f"<td>{_chip(case.float_type)}</td><td class=n>{_short(worst.error)}</td>"
        f"<td class=n>{_short(worst.allowed)}</td><td>{_bar(worst)}</td></tr>"
    )


def _mutant_row(mutant: MutantResult) -> str:
    case = mutant.worst.case
    ours, theirs = mutant.ours.relative_error, mutant.worst.relative_error
    left, right = _scale_percent(ours), _scale_percent(theirs)
    scale = (
        f'<div class="scale"><i class="span" style="left:{left:.1f}%;width:{right - left:.1f}%">'
        f'</i><i class="ours" style="left:{left:.1f}%"></i>'
        f'<i class="mutant" style="left:{right:.1f}%"></i></div>'
    )
    return (
        f"<tr><td>{escape(mutant.mutation.group)}</td><td><b>{escape(mutant.mutation.name)}</b></td>"
        f"<td>{escape(case.name)}<br><code>{escape(case.formula)}</code> {_chip(case.float_type)}"
        f"</td><td>{scale}</td><td class=n>{_short(ours) if mutant.ours.reference else 'rejected'}"
        f"</td><td class=n>{_format_mutant_error(mutant.worst)}</td>"
        f"<td class=n>{mutant.failing}</td></tr>"
    )


def _format_mutant_error(outcome: Outcome) -> str:
    """Relative error of a mutant, or the kind of result instead of a number."""
    if math.isfinite(outcome.relative_error):
        return _short(outcome.relative_error)
    kind = outcome.got.partition(":")[0]
    return _chip({"value": "a value", "failure": "breaks"}.get(kind, kind), "bad")


def _chart(of: Consistency) -> str:
    low, high = of.interval
    inside = f"{of.inside:.0%} of the matched filter's steps are inside"
    return (
        f'<div class="card"><h3>{of.name}, expected {of.size}</h3>'
        f"<p>95 % between {low:.2f} and {high:.2f}; {inside}.</p>"
        + line_chart(
            {"var(--mutant)": of.overconfident, "var(--ours)": of.matched},
            band=of.interval,
            expected=of.size,
        )
        + "</div>"
    )


def _group(group: str, of: list[Outcome]) -> str:
    rows = "".join(
        f'<tr class="formula"><td colspan=7><code>{escape(formula)}</code></td></tr>'
        + "".join(map(_case_row, members))
        for formula, members in groupby(of, key=lambda outcome: outcome.case.formula)
    )
    failing = sum(outcome.error_fraction > 1.0 for outcome in of)
    outcome = f"{failing} fail" if failing else "all pass"
    return (
        f"<details><summary>{escape(group)}<span>{len(of)} cases, {outcome}</span></summary>"
        '<div class="wide"><table><thead><tr><th>case</th><th>type</th><th>reference</th>'
        "<th>ours</th><th class=n>error</th><th class=n>allowed</th><th>used</th></tr></thead>"
        f"<tbody>{rows}</tbody></table></div></details>"
    )


def _case_row(outcome: Outcome) -> str:
    case = outcome.case
    head = f"<tr><td>{escape(case.name)}</td><td>{_chip(case.float_type)}</td>"
    if not outcome.reference:
        good = "good" if outcome.error_fraction <= 1.0 else "bad"
        said = escape(outcome.got)
        return (
            f"{head}<td>{_chip(case.expect, good)}</td><td class=said colspan=3>{said}</td>"
            f"<td>{_bar(outcome)}</td></tr>"
        )
    return (
        f'{head}<td class="digits" title="{outcome.reference}">{_cut(outcome.reference)}</td>'
        f'<td class="digits">{_agreeing(outcome.got, outcome.reference)}</td>'
        f"<td class=n>{_short(outcome.error)}</td><td class=n>{_short(outcome.allowed)}</td>"
        f"<td>{_bar(outcome)}</td></tr>"
    )


def _agreeing(got: str, reference: str) -> str:
    """Number with the digits pale that differ from the reference's."""
    digits, e, exponent = got.partition("e")
    same = next(
        (i for i, (a, b) in enumerate(zip(digits, reference, strict=False)) if a != b),
        min(len(digits), len(reference)),
    )
    return f"{digits[:same]}<i>{digits[same:]}</i>{e}{exponent}"


def _cut(reference: str) -> str:
    """Reference cut to the width of a line; the exponent stays."""
    digits, e, exponent = reference.partition("e")
    return (f"{digits[:_DIGITS]}…" if len(digits) > _DIGITS else digits) + e + exponent


def _bar(outcome: Outcome) -> str:
    bad = outcome.error_fraction > 1.0
    width = 100.0 * min(outcome.error_fraction, 1.0)
    reason = escape(outcome.case.tolerance.get("reason", "refused as it must be"), quote=True)
    exact = "exact" if outcome.reference else "held"
    share = "fails" if bad else f"{outcome.error_fraction:.0%}" if outcome.error else exact
    return (
        f'<span class="bar{" bad" * bad}" title="{reason}"><i style="width:{width:.0f}%"></i>'
        f"</span> {share}"
    )


def _scale_percent(relative_error: float) -> float:
    """Position on the error scale, in per cent."""
    if not math.isfinite(relative_error):
        return 100.0
    power = math.log10(relative_error) if relative_error > 0.0 else _LOWEST
    return 100.0 * (min(max(power, _LOWEST), _HIGHEST) - _LOWEST) / (_HIGHEST - _LOWEST)


def _short(value: float) -> str:
    return "0" if value == 0.0 else f"{value:.1e}" if math.isfinite(value) else "no number"


def _chip(text: str, kind: str = "") -> str:
    return f'<span class="chip {kind}">{escape(text)}</span>'


if __name__ == "__main__":
    sys.exit(main())
