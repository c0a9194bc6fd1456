"""Plan of an omnidirectional frame: renderer, mirror surface, samples and faces, with a reason.

Data only, and all that a renderer reads to prepare a view. `planning/` makes plans: from explicit
numbers (`explicit_plan`), or as the best candidate for an accuracy target (`plan_choice`).
"""

from __future__ import annotations

from catoptra_protocol.errors import DomainError
from catoptra_protocol.optics.cube_map import Face
from catoptra_protocol.slotted_dataclass import dataclass
from catoptra_server.render.face_region import FaceRegion
from catoptra_server.render.renderer_kind import RendererKind
from catoptra_server.robot.render_settings import MirrorSurface, PerPixel
from catoptra_server.world.mirror_mesh import Tessellation


@dataclass(frozen=True, slots=True)
class RenderPlan:
    """Plan of one camera's frames."""

    renderer: RendererKind
    surface: MirrorSurface
    samples: int
    """Samples along a pixel's side; a pixel has samples^2."""
    face_size_px: int
    """Side of a whole face in the texels of the finest region; faces only."""
    face_samples: int
    """Samples of a face's texel; faces only."""
    faces: tuple[Face, ...]
    """Faces that the mirror sees."""
    face_regions: tuple[FaceRegion, ...]
    """Visible regions of the faces, with their texel densities."""
    reason: str
    """Reason for this plan, for the log."""

    def __post_init__(self) -> None:
        if not 1 <= self.samples <= 16:
            raise DomainError(f"samples must be 1 to 16 along a pixel's side, not {self.samples}")

    def __str__(self) -> str:
        return f"{self.description}: {self.reason}"

    @property
    def has_exact_rays(self) -> bool:
        """Whether each pixel has the ray of the camera model, not of a mirror mesh."""
        return isinstance(self.surface, PerPixel)

    @property
    def description(self) -> str:
        """All numbers of the plan in words, without its reason."""
        match self.surface:
            case PerPixel():
                surface = "per pixel"
            case Tessellation(sectors, rings, interpolation):
                surface = f"{sectors} x {rings} polygons ({interpolation.value})"
        details = ""
        if self.renderer.uses_faces:
            names = "".join(face.name for face in self.faces)
            details = f", faces {names} of {self.face_size_px} px"
            details += f" with {self.face_samples} samples each" if self.face_samples > 1 else ""
        return f"{self.renderer.value}, {surface}, {self.samples}^2 samples{details}"
