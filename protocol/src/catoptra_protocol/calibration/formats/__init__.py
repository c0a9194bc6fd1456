"""Formats of calibration files, one module each.

To add a format: write `<name>.py` beside the others, with `NAME`, `CONVENTIONS`, `is_format`,
`read` and `write` of `CalibrationFormat`, and add its line to `FORMATS`.
"""

from catoptra_protocol.calibration.calibration_format import CalibrationFormat
from catoptra_protocol.calibration.formats import (
    basalt,
    boofcv,
    camodocal,
    kalibr,
    ocamcalib,
    opencv_omnidir,
    woodscape_json,
)

# In the order in which a file is tried.
FORMATS: tuple[CalibrationFormat, ...] = (
    opencv_omnidir,
    camodocal,
    boofcv,
    kalibr,
    basalt,
    woodscape_json,
    ocamcalib,
)
