"""The protocol of USARSim's control and image ports (SPEC.md, chapters 2 to 8), without sockets.

`control_connection` is both ends of a control connection, on top of `grammar` (lines, blocks and
the two dialects), `commands` and `reports` (one frozen dataclass each, and their tables).
`strict_fields` and `lenient_fields` read the fields of reports and of commands, `value_format`
prints and parses values. `image_port` holds requests and frames of the image port.
"""
