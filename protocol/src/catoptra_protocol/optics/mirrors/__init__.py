"""Mirror models by name, as robot files name them.

To add a mirror: write `<name>.py` beside the others (frozen parameters, image radius and its
inverse in the half-angle tangent, slope, surface, domain, source) and add its line to `MIRRORS`.
"""

from catoptra_protocol.optics.mirrors.hyperbolic import PAPER_MIRROR, HyperbolicMirror
from catoptra_protocol.optics.mirrors.mirror import Mirror
from catoptra_protocol.optics.mirrors.parabolic import ParabolicMirror

MIRRORS: dict[str, type[Mirror]] = {
    "hyperbolic": HyperbolicMirror,
    "parabolic": ParabolicMirror,
}

__all__ = ["MIRRORS", "PAPER_MIRROR", "HyperbolicMirror", "Mirror", "ParabolicMirror"]
