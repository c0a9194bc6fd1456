"""Who may use the page: Host, Origin and token."""

from __future__ import annotations

import dataclasses
import socket

import pytest

from catoptra_server.serve.port import create_listener
from catoptra_server.serve.web.web_access import AccessDeniedError, WebAccess, create_web_access

LOOPBACK = WebAccess(frozenset({"127.0.0.1", "localhost", "[::1]"}), "127.0.0.1", 5080)
OPEN = WebAccess(frozenset(), "robots.lan", 5080, "secret")
HERE = "127.0.0.1:5080"


def access_of(host: str) -> WebAccess:
    with create_listener(host, 0, name="view") as listener:
        access = create_web_access(host, listener)
        assert access.port == listener.getsockname()[1]
        return access


@pytest.mark.parametrize(
    "host", ["127.0.0.1:5080", "127.0.0.1", "localhost:1234", "LocalHost:80", "[::1]:5080"]
)
def test_host_of_the_loopback_is_accepted_with_any_port(host: str) -> None:
    LOOPBACK.check_headers(host, None, needs_origin=False)


@pytest.mark.parametrize(
    "host",
    [
        *("evil.example", "evil.example:5080", "127.0.0.1.evil.example", "localhost.evil.example"),
        *("", ":5080", "127.0.0.1:5080:1", "user@127.0.0.1", "127.0.0.1/x", "localhost:port"),
        *("127.0.0.1\u00e9", "127.0.0.2:5080", "0.0.0.0:5080", "[::2]", "localhost."),
    ],
)
def test_host_when_it_is_another_is_refused(host: str) -> None:
    with pytest.raises(AccessDeniedError, match="Host header"):
        LOOPBACK.check_headers(host, None, needs_origin=False)


@pytest.mark.parametrize("origin", ["http://127.0.0.1:5080", "https://127.0.0.1:5080"])
def test_origin_of_the_page_is_accepted(origin: str) -> None:
    LOOPBACK.check_headers(HERE, origin, needs_origin=True)


@pytest.mark.parametrize(
    "origin",
    [
        *("http://evil.example", "http://127.0.0.1:8888", "http://127.0.0.1", "null", ""),
        *("file://127.0.0.1:5080", "http://localhost:5080", "http://127.0.0.1:5080.evil.example"),
    ],
)
def test_origin_when_it_is_another_is_refused(origin: str) -> None:
    with pytest.raises(AccessDeniedError, match="the request comes from a page of another site"):
        LOOPBACK.check_headers(HERE, origin, needs_origin=False)


def test_origin_when_it_is_needed_must_be_there() -> None:
    LOOPBACK.check_headers(HERE, None, needs_origin=False)
    with pytest.raises(AccessDeniedError, match="needs an Origin"):
        LOOPBACK.check_headers(HERE, None, needs_origin=True)


def test_host_when_the_token_protects_may_be_any_but_not_another_than_the_origin() -> None:
    OPEN.check_headers("10.0.0.7:5080", "http://10.0.0.7:5080", needs_origin=True)
    with pytest.raises(AccessDeniedError, match="another site"):
        OPEN.check_headers("10.0.0.7:5080", "http://evil.example", needs_origin=True)


@pytest.mark.parametrize("token", [None, "", "secre", "secret ", "SECRET", "s\u00e9cret"])
def test_token_when_wrong_or_missing_is_not_authorized(token: str | None) -> None:
    with pytest.raises(AccessDeniedError, match="missing or wrong"):
        OPEN.check_token(token)
    OPEN.check_token("secret")
    LOOPBACK.check_token(token)


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "LOCALHOST"])
def test_address_of_the_loopback_needs_no_token(host: str) -> None:
    access = access_of(host)
    assert access.token is None
    assert access.link == f"http://{host.lower()}:{access.port}/"
    access.check_headers(f"{host}:1", None, needs_origin=False)


def test_address_of_ipv6_is_in_brackets() -> None:
    if not socket.has_ipv6:
        pytest.skip("this system has no IPv6")
    try:
        access = access_of("::1")
    except OSError as error:
        pytest.skip(f"this machine has no ::1: {error}")
    assert access.link == f"http://[::1]:{access.port}/"
    access.check_headers("[::1]:99", None, needs_origin=False)


@pytest.mark.parametrize("host", ["0.0.0.0", ""])
def test_address_that_others_reach_has_a_token_of_its_own_in_the_link(host: str) -> None:
    first, second = access_of(host), access_of(host)
    assert first.token is not None
    assert len(first.token) >= 43  # 32 random bytes
    assert first.token != second.token
    assert first.link == f"http://localhost:{first.port}/?token={first.token}"


def test_cookies_of_two_servers_on_one_host_have_two_names() -> None:
    other = dataclasses.replace(OPEN, port=5081)
    assert OPEN.cookie_name != other.cookie_name
