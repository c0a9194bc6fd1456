"""Warning of ports that other machines can reach."""

from __future__ import annotations

import logging

import pytest

from catoptra_server.serve.limits import warn_of_exposure
from helpers.loopback import run_scenario


@pytest.mark.parametrize("host", ["127.0.0.1", "127.5.6.7", "::1", "localhost"])
def test_loopback_is_no_exposure(host: str, caplog: pytest.LogCaptureFixture) -> None:
    run_scenario(warn_of_exposure(host))
    assert caplog.records == []


@pytest.mark.parametrize(
    ("host", "named"),
    [("0.0.0.0", "0.0.0.0"), ("::", "::"), ("", "0.0.0.0"), ("192.0.2.7", "192.0.2.7")],
)
def test_address_of_the_network_is_warned_of_in_words(
    host: str, named: str, caplog: pytest.LogCaptureFixture
) -> None:
    run_scenario(warn_of_exposure(host))
    assert [record.levelno for record in caplog.records] == [logging.WARNING]
    assert "without authentication" in caplog.text
    assert named in caplog.text


def test_unknown_host_is_left_to_the_ports(caplog: pytest.LogCaptureFixture) -> None:
    # A name that is wrong before any name server is queried.
    run_scenario(warn_of_exposure("a..b"))
    assert caplog.records == []
