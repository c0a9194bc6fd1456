"""CONF: order and missing replies of the dialects; the samples are conformance vectors."""

from __future__ import annotations

import pytest

from catoptra_protocol.usarsim.configurations import (
    CameraConfiguration,
    Configuration,
    EncoderConfiguration,
    OdometryConfiguration,
    RangeScannerConfiguration,
    ScanIntervalConfiguration,
    SonarConfiguration,
    TextureRegion,
    TouchConfiguration,
    VehicleConfiguration,
)
from catoptra_protocol.usarsim.grammar import Dialect, parse_message
from catoptra_protocol.usarsim.reports import (
    AnyConfiguration,
    line_from_report,
    report_from_message,
)

CAMERA = CameraConfiguration(
    "C", 80.0, 20.0, 120.0, 80.0, TextureRegion(0, 0, 32, 24), (("Lens", "x"),)
)
ALL: list[tuple[AnyConfiguration, str]] = [
    (VehicleConfiguration("P2AT", 14.0, 5.385, 60.0), "GroundVehicle"),
    (RangeScannerConfiguration("S", 20.0, 0.1, 0.0174, 3.1415), "RangeScanner"),
    (SonarConfiguration("F1", 5.0, 0.1, 0.3491), "Sonar"),
    (EncoderConfiguration("E", 0.0174), "Encoder"),
    (OdometryConfiguration("O", 0.2, 0.0099), "Odometry"),
    (ScanIntervalConfiguration("GPS", "G", 1.0), "GPS"),
    (TouchConfiguration("T", 0.01), "Touch"),
    (CAMERA, "Camera"),
]


@pytest.mark.parametrize("dialect", Dialect)
@pytest.mark.parametrize(("configuration", "type_"), ALL, ids=[type_ for _, type_ in ALL])
def test_configuration_when_written_is_read_with_its_type_and_name(
    configuration: AnyConfiguration, type_: str, dialect: Dialect
) -> None:
    line = line_from_report(configuration, dialect).decode().rstrip()
    read = report_from_message(parse_message(line))
    assert isinstance(read, Configuration)
    assert read.type == type_
    assert read.get("Name")
    assert len(read.pairs) > 1


def test_camera_when_written_has_its_region_in_udk_only_and_its_model_in_both() -> None:
    ut2004, udk = (line_from_report(CAMERA, dialect) for dialect in Dialect)
    assert b"Texture" not in ut2004
    assert b"{Name C}{TextureOffsetX 0}{TextureOffsetY 0}" in udk
    assert ut2004.endswith(b"{CameraFov 80.0000} {Lens x}\r\n")
    assert udk.endswith(b"{CameraFov 80.0000} {Lens x}\r\n")


@pytest.mark.parametrize("empty", [Configuration("A"), Configuration("A", (("Name", "N"),))])
def test_configuration_when_empty_has_no_line_in_udk(empty: Configuration) -> None:
    assert line_from_report(empty).startswith(b"CONF {Type A}")
    assert line_from_report(empty, Dialect.UDK) == b""


def test_scan_interval_has_two_decimals_in_ut2004_and_four_in_udk() -> None:
    ins = ScanIntervalConfiguration("INS", "INS", 0.2)
    assert b"{ScanInterval 0.20}" in line_from_report(ins)
    assert b"{ScanInterval 0.2000}" in line_from_report(ins, Dialect.UDK)
