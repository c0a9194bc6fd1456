"""Mutants of wide-angle lenses and of mirrors without a viewpoint; see mutants_optics.

No mutant replaces a function that a cached table is made of: tables outlive the mutation.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from catoptra_protocol.optics.derivatives import differentiate_point
from stability.mutations import Mutation

Floats = Any


# Lenses.


def equidistant_by_arc_cosine(self: Any, t: Floats) -> Floats:
    return np.arccos((1.0 - t * t) / (1.0 + t * t))


def equisolid_by_cosine(self: Any, t: Floats) -> Floats:
    return np.sqrt(2.0 - 2.0 * (1.0 - t * t) / (1.0 + t * t))


def kannala_brandt_by_atan(self: Any, t: Floats) -> Floats:
    return self._polynomial.evaluate(np.arctan(2.0 * t / (1.0 - t * t)))


unified_without_fold = property(lambda self: math.inf)


def double_sphere_without_domain(self: Any, t: Floats) -> Floats:
    sine, cosine = 2.0 * t / (1.0 + t * t), (1.0 - t * t) / (1.0 + t * t)
    d2 = np.sqrt(sine**2 + (self.xi + cosine) ** 2)
    return sine / (self.alpha * d2 + (1.0 - self.alpha) * (self.xi + cosine))


def orthographic_by_clamping(self: Any, ratio: Floats) -> Floats:
    return np.tan(0.5 * np.arcsin(np.clip(ratio, 0.0, 1.0)))


def enhanced_unified_without_domain(self: Any, t: Floats) -> Floats:
    """The published quotient, which goes on beyond the model's limit."""
    z = 1.0 - t * t
    d = np.sqrt(4.0 * self.beta * t * t + z * z)
    return 2.0 * t / (self.alpha * d + (1.0 - self.alpha) * z)


def ocam_by_atan(self: Any, ratio: Floats) -> Floats:
    """atan(rho / f(rho)), which ends at 90 degrees."""
    return np.tan(0.5 * np.arctan(ratio / self._height(ratio)))


def ocam_by_table(self: Any, t: Floats) -> Floats:
    """The inverse by a table of a thousand radii, as OCamCalib's own inverse is a fit."""
    radii = np.linspace(0.0, 2.0 * self.polynomial[0], 1000)
    return np.interp(2.0 * np.arctan(t), self._theta(radii), radii)


def woodscape_by_arc_cosine(self: Any, t: Floats) -> Floats:
    return self._polynomial.evaluate(np.arccos((1.0 - t * t) / (1.0 + t * t)))


def f_theta_by_table(self: Any, t: Floats) -> Floats:
    radii = np.linspace(0.0, 1000.0, 4001)
    return np.interp(2.0 * np.arctan(t), self._polynomial.evaluate(radii), radii)


def f_theta_by_arc_cosine(self: Any, t: Floats) -> Floats:
    """Newton's steps from the axis' slope, for an angle by its cosine."""
    theta = np.arccos((1.0 - t * t) / (1.0 + t * t))
    radius = theta / self.k1
    for _ in range(30):
        step = self._polynomial.evaluate(radius) - theta
        radius = radius - step / self._polynomial.slope(radius)
    return radius


def table_by_chords(self: Any, t: Floats) -> Floats:
    return np.interp(2.0 * np.arctan(t), np.radians(self.angles_deg), self.radii)


# Mirrors without a viewpoint.


def sphere_by_arc_cosine(self: Any, t: Floats) -> Floats:
    """The angle of incidence by its cosine, halved between 0 and the outline."""
    theta = 2.0 * np.arctan(t)
    low, high = np.zeros_like(theta), np.full_like(theta, self.psi_limit)
    for _ in range(60):
        psi = 0.5 * (low + high)
        sine = np.minimum(self.centre_distance_m * np.sin(psi) / self.radius_m, 1.0)
        found = 2.0 * np.arccos(np.sqrt(1.0 - sine * sine)) - psi
        low, high = np.where(found < theta, psi, low), np.where(found < theta, high, psi)
    return np.tan(0.5 * (low + high))


def cone_without_apex(self: Any, t: Floats) -> Floats:
    """theta - pi + 2 alpha, also for rays that the apex hides."""
    return np.tan(2.0 * np.arctan(t) - math.pi + 2.0 * self.half_angle_rad)


def equiangular_by_arc_cosine(self: Any, t: Floats) -> Floats:
    return np.tan(np.arccos((1.0 - t * t) / (1.0 + t * t)) / self.gain)


def mirror_by_table(self: Any, t: Floats) -> Floats:
    """Camera angles by a table of a thousand rays."""
    psi = np.linspace(0.0, 0.999 * self.psi_limit, 1000)
    return np.tan(np.interp(2.0 * np.arctan(t), self.reflect(psi).theta, psi))


WIDE = "catoptra_protocol.optics.lenses"
EQUISOLID = f"{WIDE}.equisolid.EquisolidLens.radius_ratio_from_t"
EQUIDISTANT = f"{WIDE}.equidistant.EquidistantLens.radius_ratio_from_t"
KANNALA_BRANDT = f"{WIDE}.kannala_brandt.KannalaBrandtLens.radius_ratio_from_t"
DERIVATIVES = "catoptra_protocol.optics.derivatives"
EXCESS, TURN = f"{DERIVATIVES}._excess", f"{DERIVATIVES}._Local.turn_to"
BY_DIRECTION = "stability.subjects.jacobian.differentiate_direction"
UNIFIED_INVERSE = f"{WIDE}.unified.UnifiedLens.t_from_undistorted_ratio"
EUCM_MODULE, SPHERES = f"{WIDE}.enhanced_unified", f"{WIDE}.double_sphere"
UNIFIED_FOLD = f"{WIDE}.unified.UnifiedLens.fold_rad"
DOUBLE_SPHERE = f"{WIDE}.double_sphere.DoubleSphereLens.radius_ratio_from_t"
ORTHOGRAPHIC = f"{WIDE}.orthographic.OrthographicLens.t_from_radius_ratio"
EUCM = f"{WIDE}.enhanced_unified.EnhancedUnifiedLens.radius_ratio_from_t"
OCAM = f"{WIDE}.ocam.OCamLens"
WOODSCAPE = f"{WIDE}.woodscape.WoodScapeLens.radius_ratio_from_t"
F_THETA = f"{WIDE}.f_theta.FThetaLens.radius_ratio_from_t"
TABLE = f"{WIDE}.radial_table.RadialTableLens.radius_ratio_from_t"
MIRROR = "catoptra_protocol.optics.mirrors"
SPHERE = f"{MIRROR}.spherical.SphericalMirror.radius_ratio_from_t"
CONE = f"{MIRROR}.conical.ConicalMirror.radius_ratio_from_t"
EQUIANGULAR = f"{MIRROR}.equiangular.EquiangularMirror.radius_ratio_from_t"
PROFILE = f"{MIRROR}.profile.ProfileMirror.radius_ratio_from_t"
MEASURED = f"{MIRROR}.radial_table_mirror.RadialTableMirror.radius_ratio_from_t"


def unified_by_square(lens: Any, ratio: Floats) -> Floats:
    """1 - (xi^2 - 1) m^2, squared."""
    root = 1.0 - np.square(ratio) * ((lens.xi - 1.0) * (lens.xi + 1.0))
    return ratio * (1.0 + lens.xi) / (1.0 + np.sqrt(root))


def unified_by_sum(x: Floats, z: Floats, alpha: float) -> tuple[Floats, Floats, Floats]:
    """alpha d + (1 - alpha) z, whatever the sign of z."""
    d = np.hypot(x, z)
    return alpha * d + (1.0 - alpha) * z, d, (1.0 - alpha) * d + alpha * z


def excess_by_difference(length: Floats, total: Floats, square: Floats) -> Floats:
    """2 d - (d + z), whatever the sign of z."""
    return 2.0 * length - total


def turn_of_the_pixel_alone(self: Any, point: Floats) -> Floats:
    sine, cosine = 2.0 * self.t / (1.0 + self.t**2), (1.0 - self.t**2) / (1.0 + self.t**2)
    return np.append(sine * self.azimuth, cosine)


MUTATIONS = [
    Mutation("a direction as a point", "jacobian", BY_DIRECTION, differentiate_point),
    Mutation("the digits of a pixel", "jacobian", TURN, turn_of_the_pixel_alone),
    Mutation("derivative by a difference", "jacobian", EXCESS, excess_by_difference),
    Mutation("a square of the radius", "wide_angle", UNIFIED_INVERSE, unified_by_square),
    Mutation("EUCM's sum", "wide_angle", f"{EUCM_MODULE}.project_sphere", unified_by_sum),
    Mutation("double sphere's sum", "wide_angle", f"{SPHERES}.project_sphere", unified_by_sum),
    Mutation("acos of the cosine", "wide_angle", EQUIDISTANT, equidistant_by_arc_cosine),
    Mutation("sqrt(2 - 2 cos)", "wide_angle", EQUISOLID, equisolid_by_cosine),
    Mutation("atan(rho / z), as cv2.fisheye", "wide_angle", KANNALA_BRANDT, kannala_brandt_by_atan),
    Mutation("the formula's limit alone", "wide_angle", UNIFIED_FOLD, unified_without_fold),
    Mutation("without its domain", "wide_angle", DOUBLE_SPHERE, double_sphere_without_domain),
    Mutation("tan(asin / 2), clamped", "wide_angle", ORTHOGRAPHIC, orthographic_by_clamping),
    Mutation("without the model's limit", "wide_angle", EUCM, enhanced_unified_without_domain),
    Mutation("atan(rho / f)", "wide_angle", f"{OCAM}.t_from_radius_ratio", ocam_by_atan),
    Mutation("a table of radii", "wide_angle", f"{OCAM}.radius_ratio_from_t", ocam_by_table),
    Mutation("the polynomial of an acos", "wide_angle", WOODSCAPE, woodscape_by_arc_cosine),
    Mutation("a table of pixels", "wide_angle", F_THETA, f_theta_by_table),
    Mutation("Newton for an acos", "wide_angle", F_THETA, f_theta_by_arc_cosine),
    Mutation("chords between the knots", "wide_angle", TABLE, table_by_chords),
    Mutation("incidence by acos", "non_central", SPHERE, sphere_by_arc_cosine),
    Mutation("without the apex", "non_central", CONE, cone_without_apex),
    Mutation("acos over the gain", "non_central", EQUIANGULAR, equiangular_by_arc_cosine),
    Mutation("a table of rays", "non_central", PROFILE, mirror_by_table),
    Mutation("a table of rays", "non_central", MEASURED, mirror_by_table),
]
