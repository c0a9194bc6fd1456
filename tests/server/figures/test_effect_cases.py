from __future__ import annotations

from catoptra_server.effects import EFFECTS
from catoptra_server.figures.effect_cases import CASES


def test_cases_when_listed_have_one_of_every_effect_in_optical_order() -> None:
    assert [case.effect.name for case in CASES] == [kind.name for kind in EFFECTS]
