"""All mirrors that Catoptra knows, in one visible table.

To add one: write `<name>.py` beside the others (frozen parameters, image radius and its inverse in
the half-angle tangent, surface, domain, source), then add its line here.
"""

from catoptra_protocol.optics.mirrors.central_mirror import CentralMirror
from catoptra_protocol.optics.mirrors.hyperbolic import PAPER_MIRROR, HyperbolicMirror
from catoptra_protocol.optics.mirrors.parabolic import ParabolicMirror

MIRRORS: dict[str, type[CentralMirror]] = {
    "hyperbolic": HyperbolicMirror,
    "parabolic": ParabolicMirror,
}

__all__ = ["MIRRORS", "PAPER_MIRROR", "CentralMirror", "HyperbolicMirror", "ParabolicMirror"]
