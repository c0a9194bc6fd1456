"""Every naive form must fail a case of the catalogue."""

from __future__ import annotations

import pytest

from stability.mutations import Mutation, all_mutations, noticed


@pytest.mark.parametrize("mutation", all_mutations(), ids=lambda mutation: mutation.name)
def test_naive_form_when_in_place_fails_a_case(mutation: Mutation) -> None:
    assert noticed(mutation), f"no case of {mutation.group} notices: {mutation.name}"
