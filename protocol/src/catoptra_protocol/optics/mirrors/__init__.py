"""Mirror models by name, as robot files name them.

To add a mirror: write `<name>.py` beside the others (frozen parameters, image radius and its
inverse in the half-angle tangent, slope, surface, domain, source) and add its line to `MIRRORS`.
"""

from catoptra_protocol.optics.mirrors.central_mirror import CentralMirror
from catoptra_protocol.optics.mirrors.hyperbolic import PAPER_MIRROR, HyperbolicMirror
from catoptra_protocol.optics.mirrors.parabolic import ParabolicMirror

MIRRORS: dict[str, type[CentralMirror]] = {
    "hyperbolic": HyperbolicMirror,
    "parabolic": ParabolicMirror,
}

__all__ = ["MIRRORS", "PAPER_MIRROR", "CentralMirror", "HyperbolicMirror", "ParabolicMirror"]
