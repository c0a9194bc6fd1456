"""Our server passes each row of the image port; rows of its table notice each mutation."""

from __future__ import annotations

import pytest

from conformance.check import ServerUnderTest
from conformance.conftest import PlayUnmutated, RequireNoticed
from conformance.image_mutations import IMAGE_MUTATIONS
from conformance.mutation import Mutation
from conformance.suite import Outcome, applicable_checks
from helpers.long_cases import one_of_each


def test_our_server_passes_each_row(
    picture_server: ServerUnderTest, play_unmutated: PlayUnmutated
) -> None:
    rows = [check.name for check in applicable_checks(picture_server) if check.port == "image"]
    results = [play_unmutated("image", row) for row in rows]
    # Nor is a row skipped.
    assert [one for one in results if one.outcome is not Outcome.PASSED] == []


# `make mutations` plays all of them, through all rows.
@pytest.mark.parametrize(
    "mutation",
    one_of_each(IMAGE_MUTATIONS, lambda mutation: mutation.noticed_by),
    ids=lambda mutation: mutation.name,
)
def test_mutation_when_played_fails_rows_that_pass_without_it(
    mutation: Mutation, require_noticed: RequireNoticed
) -> None:
    require_noticed(mutation)
