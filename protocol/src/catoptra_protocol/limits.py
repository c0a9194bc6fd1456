"""Every size and count that a peer could otherwise choose for us, each with its reason."""

from __future__ import annotations

# The longest input line kept. The reference accumulates without end; the longest line that any
# client is known to send is 2 kB, so 64 KiB leaves room and cannot fill a server.
MAX_LINE_BYTES = 64 * 1024

# Line end included. The Player driver, MATLAB's toolbox and UvA's clients read into 4096 bytes.
MAX_SERVER_LINE_BYTES = 4095

# Names and types are echoed in replies, so they must fit into a server line. The tightest client
# keeps tokens of 1024 bytes.
MAX_NAME_CHARS = 256

# What a client accepts: a RAW picture of 4096 x 4096 px, with its header, fits.
MAX_IMAGE_PAYLOAD_BYTES = 64 * 1024 * 1024

# Sides of a picture are 16-bit numbers, in the RAW header as in JPEG.
MAX_IMAGE_SIDE_PX = 0xFFFF

# What a client decodes, since a small JPEG can announce a huge picture: 96 MiB of RGB.
MAX_IMAGE_PIXELS = 32 * 1024 * 1024
