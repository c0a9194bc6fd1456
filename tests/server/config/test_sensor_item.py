"""Keys that all sensors of a file share: period, bounds, time stamps."""

from __future__ import annotations

import pytest

from catoptra_protocol.errors import ConfigError
from catoptra_server.config.robot_parts import SensorItem
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.config.unreal_ini import parse_sections
from catoptra_server.simulation.robot_description import Mount


def make_item(*lines: str) -> SensorItem:
    (parsed,) = parse_sections("\n".join(("[USARSensor.Any]", *lines)), file="x.ini")
    section = SectionReader(parsed.name, parsed.where, parsed.entries)
    return SensorItem(section, "S", Mount(), section)


def test_interval_when_configured_is_the_class_s_and_else_a_fifth_of_a_second() -> None:
    assert (make_item("ScanInterval=.1").interval_s, make_item().interval_s) == (0.1, 0.2)


def test_number_when_negative_is_rejected() -> None:
    with pytest.raises(ConfigError, match="MaxRange"):
        make_item("MaxRange=-1").get_float("MaxRange", 4.0)


@pytest.mark.parametrize("default", [True, False])
def test_time_stamp_when_left_open_is_the_sensor_s_default(default: bool) -> None:
    assert make_item().has_timestamp(default) is default
    assert make_item("bWithTimeStamp=true").has_timestamp(default) is True
