"""Each mutation of the image port is noticed by the rows that its table names."""

from __future__ import annotations

import pytest

from conformance.conftest import RequireNoticed
from conformance.image_mutations import IMAGE_MUTATIONS
from conformance.mutation import Mutation


@pytest.mark.parametrize("mutation", IMAGE_MUTATIONS, ids=lambda mutation: mutation.name)
def test_mutation_when_played_fails_rows_that_pass_without_it(
    mutation: Mutation, require_noticed: RequireNoticed
) -> None:
    require_noticed(mutation)
