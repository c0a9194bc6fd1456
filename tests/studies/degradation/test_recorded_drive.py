"""Logs made of a recorded drive and the detections in its frames."""

from __future__ import annotations

import pytest

from catoptra_client.control_connection import ServerAddress
from catoptra_protocol.errors import CatoptraError
from catoptra_studies.degradation.recorded_drive import add_measurements, record_drive
from catoptra_studies.experiment.experiment_setups import MAX_RANGE_M, SIM
from helpers.recorded_drives import NEAR, make_detection, make_drive, make_frame


def test_log_has_near_detections_in_their_steps() -> None:
    near, far = make_detection("near", 1.02, 0.5), make_detection("far", MAX_RANGE_M + 0.01, 90.0)
    log = add_measurements(make_drive(make_frame(NEAR), make_frame(NEAR)), [(), (near, far)])
    assert [len(step.measurements) for step in log.steps] == [0, 0, 1]
    (measurement,) = log.steps[2].measurements
    assert (measurement.name, measurement.range_m, measurement.bearing_rad) == (
        "near",
        1.02,
        near.bearing_rad,
    )


def test_log_when_a_frame_has_no_detections_entry_is_rejected() -> None:
    with pytest.raises(ValueError, match="shorter"):
        add_measurements(make_drive(make_frame(NEAR), make_frame(NEAR)), [()])


def test_recording_when_the_stream_port_is_unknown_is_rejected() -> None:
    with pytest.raises(CatoptraError, match="stream"):
        record_drive(SIM, 0, ServerAddress("127.0.0.1", 1, 1))
