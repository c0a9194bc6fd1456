"""Every mutant fails a case of the catalogue."""

from __future__ import annotations

import pytest

from stability.mutations import Mutation, all_mutations, failing_cases


@pytest.mark.parametrize("mutation", all_mutations(), ids=lambda mutation: mutation.name)
def test_mutant_fails_a_case(mutation: Mutation) -> None:
    assert failing_cases(mutation), f"no case of {mutation.group} notices: {mutation.name}"
