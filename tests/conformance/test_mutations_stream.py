"""Each mutation of the stream is noticed by the rows that its table names."""

from __future__ import annotations

import pytest

from conformance.conftest import RequireNoticed
from conformance.mutation import Mutation
from conformance.stream_mutations import STREAM_MUTATIONS


@pytest.mark.parametrize("mutation", STREAM_MUTATIONS, ids=lambda mutation: mutation.name)
def test_mutation_when_played_fails_rows_that_pass_without_it(
    mutation: Mutation, require_noticed: RequireNoticed
) -> None:
    require_noticed(mutation)
