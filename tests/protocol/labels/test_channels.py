"""The table of channels, and requests for channels by name."""

from __future__ import annotations

import numpy as np
import pytest

from catoptra_protocol.errors import DomainError
from catoptra_protocol.labels.channels import LABEL_CHANNELS, parse_channels


def test_channels_are_listed_in_the_order_of_the_table() -> None:
    assert [channel.name for channel in parse_channels(("ids", "range"))] == ["range", "ids"]


@pytest.mark.parametrize(
    ("names", "message"),
    [(("depth",), "'depth': the channels are range"), (("ids", "ids"), "twice")],
)
def test_unknown_and_repeated_channels_are_rejected(names: tuple[str, ...], message: str) -> None:
    with pytest.raises(DomainError, match=message):
        parse_channels(names)


@pytest.mark.parametrize("channel", LABEL_CHANNELS.values(), ids=lambda channel: channel.name)
def test_values_of_nothing_fit_the_type(channel) -> None:
    image = np.full(channel.shape(2, 3), channel.nothing, dtype=channel.dtype)
    assert image.shape[:2] == (2, 3)
    assert np.array_equal(
        image.astype(float), np.full_like(image, channel.nothing, dtype=float), equal_nan=True
    )
