"""The table of what a server says, and the header as people read it."""

from __future__ import annotations

import dataclasses

from catoptra_protocol.stream.replies import (
    REPLIES,
    LandmarkRecord,
    StartPoseRecord,
    Transform,
)
from catoptra_protocol.stream.requests import REQUESTS
from helpers.configs import REPOSITORY
from helpers.stream_messages import HEADER

SPECIFICATION = REPOSITORY / "protocol/SPEC.md"


def test_answers_are_kept_under_their_kinds() -> None:
    assert all(kind == form.KIND for kind, form in REPLIES.items())


def test_header_when_logged_says_what_matters() -> None:
    assert str(HEADER) == "frame 42 of 'Omni', 6 x 4 px raw, 30.0 ms old"


def test_specification_names_every_kind_and_field() -> None:
    chapter = SPECIFICATION.read_text(encoding="utf-8").partition("## 9. The modern stream")[2]
    for form in (*REQUESTS.values(), *REPLIES.values(), Transform, LandmarkRecord, StartPoseRecord):
        names = [field.name for field in dataclasses.fields(form)]
        for name in [*names, getattr(form, "KIND", "id")]:
            assert f"`{name}`" in chapter, f"{form.__name__}: {name}"
