"""Limits of every size and count that a peer could otherwise choose, each with its reason."""

from __future__ import annotations

# Longest input line in memory. The reference accumulates without limit; the longest line that any
# known client sends is 2 kB, so 64 KiB is ample and cannot exhaust a server.
MAX_LINE_BYTES = 64 * 1024

# Line end included. The Player driver, MATLAB's toolbox and the clients of UvA read into 4096
# bytes.
MAX_SERVER_LINE_BYTES = 4095

# Names and types are echoed in replies, so they must fit into a server line. The client with the
# smallest buffers has tokens of 1024 bytes.
MAX_NAME_CHARS = 256

# A client accepts a RAW image of 4096 x 4096 px, with its header.
MAX_IMAGE_PAYLOAD_BYTES = 64 * 1024 * 1024

# Sides of an image are 16-bit numbers, in the RAW header as in JPEG.
MAX_IMAGE_SIDE_PX = 0xFFFF

# A small JPEG can announce a huge image, so a client checks this before decoding: 96 MiB of RGB.
MAX_IMAGE_PIXELS = 32 * 1024 * 1024
