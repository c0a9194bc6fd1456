"""Lens models by name, as robot files name them.

To add a lens: write `<name>.py` beside the others (frozen parameters, image radius and its inverse
in the half-angle tangent, slope, limit, first fold, source), add its line to `LENSES`, and its
parameters to `catoptra_protocol.camera_conf.LENS_PARAMETERS`. No renderer needs to know it.
"""

from typing import TYPE_CHECKING

from catoptra_protocol.lazy_table import LazyTable
from catoptra_protocol.optics.radial_camera import RadialProjection

LENSES: LazyTable[type[RadialProjection]] = LazyTable(
    __name__,
    {
        "equidistant": "equidistant.EquidistantLens",
        "equisolid": "equisolid.EquisolidLens",
        "stereographic": "stereographic.StereographicLens",
        "orthographic": "orthographic.OrthographicLens",
        "kannala_brandt": "kannala_brandt.KannalaBrandtLens",
        "unified": "unified.UnifiedLens",
        "enhanced_unified": "enhanced_unified.EnhancedUnifiedLens",
        "double_sphere": "double_sphere.DoubleSphereLens",
        "ocam": "ocam.OCamLens",
        "woodscape": "woodscape.WoodScapeLens",
        "f_theta": "f_theta.FThetaLens",
        "radial_table": "radial_table.RadialTableLens",
    },
)

if TYPE_CHECKING:
    from catoptra_protocol.optics.lenses.double_sphere import DoubleSphereLens
    from catoptra_protocol.optics.lenses.enhanced_unified import EnhancedUnifiedLens
    from catoptra_protocol.optics.lenses.equidistant import EquidistantLens
    from catoptra_protocol.optics.lenses.equisolid import EquisolidLens
    from catoptra_protocol.optics.lenses.f_theta import FThetaLens
    from catoptra_protocol.optics.lenses.kannala_brandt import KannalaBrandtLens
    from catoptra_protocol.optics.lenses.ocam import OCamLens
    from catoptra_protocol.optics.lenses.orthographic import OrthographicLens
    from catoptra_protocol.optics.lenses.radial_table import RadialTableLens
    from catoptra_protocol.optics.lenses.stereographic import StereographicLens
    from catoptra_protocol.optics.lenses.unified import UnifiedLens
    from catoptra_protocol.optics.lenses.woodscape import WoodScapeLens
else:
    __getattr__ = LENSES.find_attribute

__all__ = [
    "LENSES",
    "DoubleSphereLens",
    "EnhancedUnifiedLens",
    "EquidistantLens",
    "EquisolidLens",
    "FThetaLens",
    "KannalaBrandtLens",
    "OCamLens",
    "OrthographicLens",
    "RadialTableLens",
    "StereographicLens",
    "UnifiedLens",
    "WoodScapeLens",
]
