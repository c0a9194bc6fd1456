from __future__ import annotations

from catoptra_server.effects import EFFECT_TYPES
from catoptra_studies.effects.effect_cases import EFFECT_CASES


def test_cases_when_listed_have_one_of_every_effect_in_optical_order() -> None:
    assert [case.effect.name for case in EFFECT_CASES] == [kind.name for kind in EFFECT_TYPES]
