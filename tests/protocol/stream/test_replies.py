"""The table of replies, and their chapter of the specification."""

from __future__ import annotations

import dataclasses

from catoptra_protocol.stream.replies import (
    REPLIES,
    DifferenceRecord,
    EffectRecord,
    LandmarkRecord,
    NoteRecord,
    PlanAlternative,
    RobotState,
    StartPoseRecord,
)
from catoptra_protocol.stream.requests import REQUESTS, FrameVariant, Transform
from helpers.configs import REPOSITORY

# Dataclasses inside messages; they have no kind of their own.
RECORDS = (
    *(Transform, LandmarkRecord, StartPoseRecord, EffectRecord, PlanAlternative),
    *(FrameVariant, DifferenceRecord, RobotState, NoteRecord),
)
SPECIFICATION = REPOSITORY / "protocol/SPEC.md"


def test_replies_are_listed_under_their_kinds() -> None:
    assert all(kind == reply.KIND for kind, reply in REPLIES.items())


def test_specification_names_every_kind_and_field() -> None:
    chapter = SPECIFICATION.read_text(encoding="utf-8").partition("## 9. The ZeroMQ stream")[2]
    for message_type in (*REQUESTS.values(), *REPLIES.values(), *RECORDS):
        names = [field.name for field in dataclasses.fields(message_type)]
        for name in [*names, getattr(message_type, "KIND", "id")]:
            assert f"`{name}`" in chapter, f"{message_type.__name__}: {name}"
