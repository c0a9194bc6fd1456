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

# Blocks of a line: a parser's time grows with them. A line of 4095 bytes, the longest that a server
# sends, holds 680 blocks of a name and a value.
MAX_LINE_BLOCKS = 1024

# Joints or links of one motion command: four times the joints of any robot, and 0.1 ms to execute.
MAX_COMMAND_JOINTS = 256

# Magnitude of a number in a motion command, in any unit: above every speed, angle and torque, and
# far below the numbers at which sums of products overflow.
MAX_COMMAND_NUMBER = 1e9

# A client accepts a RAW image of 4096 x 4096 px, with its header.
MAX_IMAGE_PAYLOAD_BYTES = 64 * 1024 * 1024

# Sides of an image are 16-bit numbers, in the RAW header as in JPEG.
MAX_IMAGE_SIDE_PX = 0xFFFF

# A small JPEG can announce a huge image, so a client checks this before decoding: 96 MiB of RGB.
MAX_IMAGE_PIXELS = 32 * 1024 * 1024

# A field has six landmarks, a large building some hundred. Each is a few hundred triangles of the
# scene and an entry of a reply: 1024 are 0.3 million triangles.
MAX_LANDMARKS = 1024

# 256 bytes for each of MAX_LANDMARKS; rows of real files have 60.
MAX_LANDMARK_FILE_BYTES = 256 * 1024

# A note about a robot: a pose, its covariance and fifty detections are 5 kB of JSON.
MAX_NOTE_BYTES = 8 * 1024

# Notes of one robot under different names: two localizers with all their stages.
MAX_NOTES = 8

# A note's name labels a line of a viewer's legend.
MAX_NOTE_NAME_CHARS = 64

# The longest request of the stream publishes a note of 8 KiB, whose quotes and backslashes take two
# bytes each in JSON; the others hold a few numbers and names of at most 256 characters.
MAX_REQUEST_BYTES = 16 * 1024
