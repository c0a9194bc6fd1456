"""What the sections of all omnidirectional cameras have: image, samples, accuracy, memory."""

from __future__ import annotations

from catoptra_protocol.optics.radial_camera import Picture
from catoptra_server.config.section_reader import SectionReader
from catoptra_server.frames.plan.plans import omni_view_size, requested_samples
from catoptra_server.render.render_settings import AccuracyTarget, MirrorSurface, RenderSettings
from catoptra_server.runtime.memory import MemoryBudget
from catoptra_server.simulation.robot_description import OmniCameraDescription

MAX_SIDE_PX = 8192
"""8192^2 raw pixels are 201 MB for a frame; the largest texture of OpenGL devices is not far
above."""


def read_picture(section: SectionReader, default: Picture) -> Picture:
    """Hand of a camera's picture."""
    names = [picture.value for picture in Picture]
    return Picture(section.get_choice("Picture", names, default.value))


def read_min_frame_interval_s(section: SectionReader) -> float:
    """Shortest simulation time between two exposures."""
    return section.get_float("FrameInterval", 0.0, min_value=0.0, max_value=60.0)


def read_render_settings(
    section: SectionReader,
    *,
    surface: MirrorSurface,
    face_size_px: int,
    central_error_px: float = 0.0,
) -> RenderSettings:
    """Settings of a camera's frames.

    Args:
        section: the capture camera's section.
        surface: the mirror's mesh, or the exact surface.
        face_size_px: texels along a cube face; 0 lets the plan choose sizes by density.
        central_error_px: error up to which frames of a mirror without a viewpoint may have one.
    """
    return RenderSettings(
        surface=surface,
        # Without a key the plan's default, which is no number of samples that a file could state.
        samples=section.get_int("Samples", 0, min_value=1, max_value=16),
        face_size_px=face_size_px,
        face_samples=section.get_int("FaceSamples", 0, min_value=1, max_value=8),
        central_error_px=central_error_px,
        accuracy_target=AccuracyTarget(
            max_error_px=section.get_float("MaxErrorPx", 0.0, min_value=0.0, max_value=1000.0),
            budget_ms=section.get_float("BudgetMs", 0.0, min_value=0.0, max_value=60_000.0),
        ),
    )


def reserve_view(omni: OmniCameraDescription, section: SectionReader, memory: MemoryBudget) -> None:
    """Raise ConfigError for a view that would take too much memory, before any is taken."""
    camera, settings = omni.camera, omni.render_settings
    size = omni_view_size(camera, settings, has_effects=bool(omni.effects.settings))
    samples = requested_samples(settings)
    faces = f", faces of {settings.face_size_px} px" if settings.face_size_px else ""
    memory.reserve(
        size.num_bytes,
        where=section.find_location("ResolutionX"),
        key=f"{section.name}.ResolutionX",
        value=f"{camera.width_px} x {camera.height_px} px, Samples={samples}{faces}",
        remedy="fewer pixels, Samples, or texels (TextureSize, FaceSamples)",
    )
