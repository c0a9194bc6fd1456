"""The table of what a client may ask."""

from __future__ import annotations

import dataclasses

from catoptra_protocol.stream.requests import REQUESTS


def test_requests_are_kept_under_their_kinds_and_carry_an_id() -> None:
    for kind, form in REQUESTS.items():
        assert kind == form.KIND == kind.lower()
        assert dataclasses.fields(form)[0].name == "id"
