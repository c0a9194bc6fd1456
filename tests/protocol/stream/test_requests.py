"""The table of requests."""

from __future__ import annotations

import dataclasses

from catoptra_protocol.stream.requests import REQUESTS


def test_requests_are_listed_under_their_kinds_and_have_an_id() -> None:
    for kind, request in REQUESTS.items():
        assert kind == request.KIND == kind.lower()
        assert dataclasses.fields(request)[0].name == "id"
