"""Mirror models by name, as robot files name them.

To add a mirror: write `<name>.py` beside the others (frozen parameters, image radius and its
inverse in the half-angle tangent, slope, surface, domain, source; without a single viewpoint a
`reflect` suffices, see `non_central`) and add its line to `MIRRORS`.
"""

from typing import TYPE_CHECKING

from catoptra_protocol.lazy_table import LazyTable
from catoptra_protocol.optics.mirrors.hyperbolic import PAPER_MIRROR, HyperbolicMirror
from catoptra_protocol.optics.mirrors.mirror import Mirror

MIRRORS: LazyTable[type[Mirror]] = LazyTable(
    __name__,
    {
        "hyperbolic": "hyperbolic.HyperbolicMirror",
        "parabolic": "parabolic.ParabolicMirror",
        "spherical": "spherical.SphericalMirror",
        "conical": "conical.ConicalMirror",
        "equiangular": "equiangular.EquiangularMirror",
        "profile": "profile.ProfileMirror",
        "radial_table": "radial_table_mirror.RadialTableMirror",
    },
)

if TYPE_CHECKING:
    from catoptra_protocol.optics.mirrors.conical import ConicalMirror
    from catoptra_protocol.optics.mirrors.equiangular import EquiangularMirror
    from catoptra_protocol.optics.mirrors.parabolic import ParabolicMirror
    from catoptra_protocol.optics.mirrors.profile import ProfileMirror
    from catoptra_protocol.optics.mirrors.radial_table_mirror import RadialTableMirror
    from catoptra_protocol.optics.mirrors.spherical import SphericalMirror
else:
    __getattr__ = MIRRORS.find_attribute

__all__ = [
    "MIRRORS",
    "PAPER_MIRROR",
    "ConicalMirror",
    "EquiangularMirror",
    "HyperbolicMirror",
    "Mirror",
    "ParabolicMirror",
    "ProfileMirror",
    "RadialTableMirror",
    "SphericalMirror",
]
