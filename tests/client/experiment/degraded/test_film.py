"""What a film becomes when somebody has looked at it."""

from __future__ import annotations

import pytest

from catoptra_client.experiment.degraded.film import filmed, with_sightings
from catoptra_client.experiment.server_process import ServerAddress
from catoptra_client.experiment.setups import LONGEST_RANGE_M, SIM
from catoptra_protocol.errors import CatoptraError
from helpers.films import NEAR, film, shot, sighting


def test_drive_when_looked_at_has_near_sightings_in_their_steps() -> None:
    near, far = sighting("near", 1.02, 0.5), sighting("far", LONGEST_RANGE_M + 0.01, 90.0)
    looked = with_sightings(film(shot(NEAR), shot(NEAR)), [(), (near, far)])
    assert [len(step.seen) for step in looked.steps] == [0, 0, 1]
    (seen,) = looked.steps[2].seen
    assert (seen.name, seen.range_m, seen.bearing_rad) == ("near", 1.02, near.bearing_rad)


def test_drive_when_a_shot_was_not_looked_at_is_refused() -> None:
    with pytest.raises(ValueError, match="shorter"):
        with_sightings(film(shot(NEAR), shot(NEAR)), [()])


def test_film_when_nobody_knows_the_stream_is_refused() -> None:
    with pytest.raises(CatoptraError, match="stream"):
        filmed(SIM, 0, ServerAddress("127.0.0.1", 1, 1), on_step=lambda: None)
