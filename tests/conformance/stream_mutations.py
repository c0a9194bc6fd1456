"""Mutations of the stream, and what notices each of them.

The first group shows in the form of one message, the second one in its meaning alone.
"""

from __future__ import annotations

from conformance.mutation import Mutation
from conformance.stream_message_mutations import (
    Connect,
    Fields,
    drop_field,
    freeze_field,
    of_kind,
    of_messages,
    of_messages_with_state,
    repeat_first_image,
    set_field,
    set_landmark,
    set_model_field,
    set_raw_picture,
)

_OFFSET_PX = 5.0


def _mutation(name: str, connect: Connect, *noticed_by: str) -> Mutation:
    return Mutation(name, "stream", connect, noticed_by)


def _move_pixel(landmark: Fields) -> Fields:
    if landmark["pixel"] is None:
        return landmark
    u, v = landmark["pixel"]
    return {**landmark, "pixel": [u + _OFFSET_PX, v]}


def _negate_visible(landmark: Fields) -> Fields:
    visible = landmark["visible"]
    return {**landmark, "visible": None if visible is None else not visible}


def _swap_colours(landmark: Fields) -> Fields:
    lower, upper = landmark["lower_colour"], landmark["upper_colour"]
    return {**landmark, "lower_colour": upper, "upper_colour": lower}


def _transpose(transform: Fields) -> Fields:
    """Rotation in the opposite sense."""
    rotation = transform["rotation"]
    return {**transform, "rotation": [rotation[i] for i in (0, 3, 6, 1, 4, 7, 2, 5, 8)]}


FORM_MUTATIONS = (
    _mutation("no pulse", of_messages(of_kind("heartbeat", lambda *_: None)), "stream_heartbeats"),
    _mutation(
        "camera without a field",
        of_messages(of_kind("frame", set_model_field("CentreU", lambda _: None))),
        "stream_frame_raw",
    ),
    _mutation(
        "camera of an unknown mirror",
        of_messages(of_kind("frame", set_model_field("Mirror", lambda _: "spherical"))),
        "stream_frame_raw",
    ),
    _mutation(
        "constant sequence",
        of_messages(of_kind("frame", set_field("sequence", lambda _: 1))),
        "stream_frame_raw",
    ),
    _mutation(
        "short picture",
        of_messages(of_kind("frame", lambda fields, parts: (fields, [parts[0][:-3]]))),
        "stream_frame_raw",
    ),
    _mutation(
        "mislabelled picture",
        of_messages(of_kind("frame", set_field("encoding", lambda _: "png"))),
        "stream_frame_raw",
    ),
    _mutation(
        "version 2",
        of_messages(of_kind("frame", set_field("version", lambda _: 2))),
        "stream_frame_raw",
    ),
    _mutation(
        "wrong id",
        of_messages(of_kind("status", set_field("id", lambda id_: id_ + 1))),
        "stream_status",
    ),
    _mutation(
        "missing field", of_messages(of_kind("frame", drop_field("age_s"))), "stream_frame_raw"
    ),
)

MEANING_MUTATIONS = (
    _mutation(
        "landmark's pixel + 5 px", of_messages(set_landmark(_move_pixel)), "stream_landmark_pixels"
    ),
    _mutation(
        "visible negated", of_messages(set_landmark(_negate_visible)), "stream_landmark_colours"
    ),
    _mutation(
        "colours swapped", of_messages(set_landmark(_swap_colours)), "stream_landmark_colours"
    ),
    _mutation(
        "HorizonRadius + 10 %",
        of_messages(set_model_field("HorizonRadius", lambda text: repr(1.1 * float(text)))),
        "stream_camera_conf",
        "stream_landmark_pixels",
    ),
    _mutation(
        "UpAzimuth wrong",
        of_messages(set_model_field("UpAzimuth", lambda text: repr(float(text) + 0.5))),
        "stream_camera_conf",
        "stream_landmark_pixels",
    ),
    _mutation(
        "HorizonRadius of frames + 10 %",
        of_messages(
            of_kind("frame", set_model_field("HorizonRadius", lambda text: repr(1.1 * float(text))))
        ),
        "stream_camera_model",
    ),
    _mutation(
        "world_from_robot frozen",
        of_messages_with_state(freeze_field("world_from_robot")),
        "stream_turn",
        "stream_poses",
    ),
    _mutation(
        "world_from_robot inverted",
        of_messages(of_kind("frame", set_field("world_from_robot", _transpose))),
        "stream_turn",
        "stream_landmark_pixels",
    ),
    _mutation("time_s frozen", of_messages_with_state(freeze_field("time_s")), "stream_clock"),
    _mutation(
        "R and B swapped",
        of_messages(set_raw_picture(lambda picture: picture[..., ::-1])),
        "stream_encodings",
        "stream_landmark_colours",
    ),
    _mutation(
        "raw rows upside down",
        of_messages(set_raw_picture(lambda picture: picture[::-1])),
        "stream_encodings",
        "stream_landmark_colours",
        "stream_turn",
    ),
    _mutation(
        "raw rows mirrored",
        of_messages(set_raw_picture(lambda picture: picture[:, ::-1])),
        "stream_encodings",
        "stream_turn",
    ),
    _mutation("picture stale", of_messages_with_state(repeat_first_image), "stream_turn"),
    _mutation(
        "no bound",
        of_messages(of_kind("frame", set_field("error_bound_px", lambda _: None))),
        "stream_bound",
    ),
    _mutation(
        "negative bound",
        of_messages(of_kind("frame", set_field("error_bound_px", lambda bound: -bound))),
        "stream_bound",
    ),
    _mutation(
        "age_s in milliseconds",
        of_messages(of_kind("frame", set_field("age_s", lambda age_s: 1000.0 * age_s))),
        "stream_clock",
    ),
    _mutation(
        "azimuth of get_pixel reversed",
        of_messages(of_kind("pixel", set_field("azimuth_rad", lambda angle: -angle))),
        "stream_pixel_rays",
    ),
    _mutation(
        "range of get_pixel in centimetres",
        of_messages(of_kind("pixel", set_field("range_m", lambda range_m: 100.0 * range_m))),
        "stream_pixel_rays",
    ),
)

STREAM_MUTATIONS: tuple[Mutation, ...] = (*FORM_MUTATIONS, *MEANING_MUTATIONS)
