"""Rays to the effective viewpoint are reflected into the pinhole, and only those."""

from __future__ import annotations

import dataclasses

import numpy as np

from catoptra_studies.camera_figures.viewpoint_figure import reflection_miss_m
from catoptra_studies.study_subject import StudySubject

THETA_RAD = np.radians(np.arange(5.0, 120.0, 5.0))


def test_rays_to_the_viewpoint_are_reflected_into_the_pinhole(subject: StudySubject) -> None:
    # The central difference of step 1e-5 leaves 1e-10 of the tangent, times 0.1 m.
    assert reflection_miss_m(subject.camera, THETA_RAD).max() < 1e-9


def test_rays_to_another_mirror_miss_its_pinhole(subject: StudySubject) -> None:
    class MovedPinhole:
        """The mirror with a pinhole a millimetre too near."""

        surface_point = subject.camera.mirror.surface_point
        pinhole_distance_m = subject.camera.mirror.pinhole_distance_m - 1e-3

    moved = dataclasses.replace(subject.camera)
    object.__setattr__(moved, "projection", MovedPinhole())
    assert reflection_miss_m(moved, THETA_RAD).max() > 1e-5
