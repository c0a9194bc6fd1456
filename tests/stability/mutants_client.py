"""Mutants of the client's formulas: forms as a textbook or a first attempt has them.

Each mutant replaces a function of the client and must fail a case of its group.
"""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import Any

import numpy as np

from catoptra_client.landmarks.classifier import Histogram
from catoptra_client.localization import Belief, Control
from catoptra_client.localization.ekf import (
    BearingOnly,
    PredictedMeasurement,
    covariance_square_root,
)
from catoptra_client.localization.motion_model import OdometryPose
from catoptra_protocol.optics.numerics import TWO_PI
from stability.mutations import Mutation

Floats = np.ndarray


def wrap_by_modulo(angle: float) -> float:
    return (angle + math.pi) % TWO_PI - math.pi


def wrap_anything(angle: float) -> float:
    wrapped = math.remainder(angle, TWO_PI) if math.isfinite(angle) else math.nan
    return math.pi if wrapped <= -math.pi else wrapped


def subtract_plainly(angle: float, start: float) -> float:
    return angle - start


def interpolate_plainly(start: float, end: float, *, fraction: float) -> float:
    return start + fraction * (end - start)


def propagate_by_radius(pose: Floats, control: Control) -> Floats:
    radius = control.distance_m / control.turn_rad
    phi, new = pose[2], pose[2] + control.turn_rad
    x = pose[0] + radius * (math.sin(new) - math.sin(phi))
    y = pose[1] - radius * (math.cos(new) - math.cos(phi))
    return np.array([x, y, subtract_plainly(new, 0.0)])


def propagate_by_radius_guarded(pose: Floats, control: Control) -> Floats:
    tiny = abs(control.turn_rad) < 1e-9
    return propagate_straight(pose, control) if tiny else propagate_by_radius(pose, control)


def propagate_straight(pose: Floats, control: Control) -> Floats:
    middle = pose[2] + 0.5 * control.turn_rad
    step = control.distance_m * np.array([math.cos(middle), math.sin(middle)])
    return np.array([*(pose[:2] + step), pose[2] + control.turn_rad])


def derivative_in_closed_form(a: float) -> float:
    return (a * math.cos(a) - math.sin(a)) / a**2 if a else 0.0


def control_by_distance(previous: OdometryPose, current: OdometryPose) -> Control:
    chord = math.hypot(current.x_m - previous.x_m, current.y_m - previous.y_m)
    return Control(chord, current.yaw_rad - previous.yaw_rad)


def predict_with(pose: Floats, landmark: Any, bearing: Any) -> tuple[PredictedMeasurement, bool]:
    dx, dy = landmark.x_m - float(pose[0]), landmark.y_m - float(pose[1])
    rho = math.sqrt(dx * dx + dy * dy)
    if not rho:
        return PredictedMeasurement(0.0, 0.0, np.zeros((2, 3))), False
    q = rho * rho
    jacobian = np.array([[-dx / rho, -dy / rho, 0.0], [dy / q, -dx / q, -1.0]])
    return PredictedMeasurement(rho, bearing(dx, dy, rho) - float(pose[2]), jacobian), True


def predict_by_squares(pose: Floats, landmark: Any) -> tuple[PredictedMeasurement, bool]:
    return predict_with(pose, landmark, lambda dx, dy, rho: math.atan2(dy, dx))


def predict_by_acos(pose: Floats, landmark: Any) -> tuple[PredictedMeasurement, bool]:
    return predict_with(pose, landmark, lambda dx, dy, rho: math.acos(dx / rho))


def innovation_without_wrap(
    measured: Any, expected: PredictedMeasurement
) -> tuple[Floats, Floats, Floats]:
    assert not isinstance(measured, BearingOnly)
    off = (measured.range_m - expected.range_m, measured.bearing_rad - expected.bearing_rad)
    return np.array(off), expected.jacobian, measured.covariance


def range_by_tangent(t: float, *, drop_m: float) -> tuple[float, bool]:
    range_m = drop_m * math.tan(2.0 * math.atan(t))
    return range_m, range_m >= 0.0


def range_without_validity(t: float, *, drop_m: float) -> tuple[float, bool]:
    return drop_m * 2.0 * t / ((1.0 - t) * (1.0 + t)) if t != 1.0 else 0.0, True


def apply_gain(belief: Belief, K: Floats, innovation: Floats, covariance: Floats) -> Any:
    symmetric = 0.5 * (covariance + covariance.T)
    return Belief(belief.mean + K @ innovation, symmetric), True


def kalman_gain(belief: Belief, H: Floats, L: Floats) -> Floats:
    return np.linalg.solve(L.T, np.linalg.solve(L, H @ belief.covariance)).T


def correct_by_subtraction(
    belief: Belief, off: Floats, H: Floats, R_root: Floats, L: Floats
) -> Any:
    K = kalman_gain(belief, H, L)
    return apply_gain(belief, K, off, belief.covariance - K @ L @ L.T @ K.T)


def correct_by_short_form(belief: Belief, off: Floats, H: Floats, R_root: Floats, L: Floats) -> Any:
    K = kalman_gain(belief, H, L)
    return apply_gain(belief, K, off, (np.eye(3) - K @ H) @ belief.covariance)


def correct_by_information(
    belief: Belief, off: Floats, H: Floats, R_root: Floats, L: Floats
) -> Any:
    prior = np.linalg.inv(belief.covariance)
    information = np.linalg.inv(R_root @ R_root.T)
    covariance = np.linalg.inv(prior + H.T @ information @ H)
    return apply_gain(belief, covariance @ H.T @ information, off, covariance)


def root_by_cholesky(covariance: Floats) -> tuple[Floats, bool]:
    return np.linalg.cholesky(covariance), True


def root_without_pivots(covariance: Floats) -> tuple[Floats, bool]:
    root = np.zeros_like(covariance)
    for i, row in enumerate(covariance):
        for j in range(i):
            rest = row[j] - root[i] @ root[j]
            root[i, j] = rest / root[j, j] if root[j, j] else 0.0
        root[i, i] = math.sqrt(max(row[i] - root[i] @ root[i], 0.0))
    return root, True


def root_up_to_1e_9(covariance: Floats) -> tuple[Floats, bool]:
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0)), bool(values[0] >= -1e-9)


def root_of_anything(covariance: Floats) -> tuple[Floats, bool]:
    return covariance_square_root(covariance)[0], True


def always_finite(*arrays: Any) -> bool:
    return True


def cholesky_of_anything(S: Floats) -> tuple[Floats, bool]:
    return np.linalg.cholesky(S + 1e-12 * np.eye(len(S))), True


def threshold_of_upper_tail(gate: Any, dof: int) -> float:
    if dof == 2:
        return -2.0 * math.log(gate.false_rejection_rate)
    return NormalDist().inv_cdf(1.0 - 0.5 * gate.false_rejection_rate) ** 2


def nees_by_inverse(belief: Belief, true_pose: Floats) -> tuple[float, bool]:
    error = belief.mean - true_pose
    return float(error @ np.linalg.inv(belief.covariance) @ error), True


def quantile_by_cube_root(dof: int, probability: float) -> float:
    spread = 2.0 / (9.0 * dof)
    return dof * (1.0 - spread + NormalDist().inv_cdf(probability) * spread**0.5) ** 3


def compare_by_division(positive: Histogram, negative: Histogram, *, theta: float) -> Floats:
    with np.errstate(all="ignore"):
        likely = positive.counts / positive.total
        return likely / (negative.counts / negative.total) >= theta


def compare_by_quotients(positive: Histogram, negative: Histogram, *, theta: float) -> Floats:
    with np.errstate(all="ignore"):
        return positive.counts / positive.total >= theta * (negative.counts / negative.total)


def compare_in_64_bits(positive: Histogram, negative: Histogram, *, theta: float) -> Floats:
    with np.errstate(all="ignore"):
        return positive.counts * negative.total >= theta * (negative.counts * positive.total)


def no_check(*_: Any) -> None:
    return None


def range_by_quotient(slope: float, *, drop_m: float) -> tuple[float, bool]:
    return drop_m / slope, True


_FILTER = "catoptra_client.localization."
_LANDMARKS = "catoptra_client.landmarks."
_ANGLES = "catoptra_protocol.optics.numerics."

MUTATIONS: list[Mutation] = [
    Mutation("wrap by modulo", "angles", _ANGLES + "wrap_angle", wrap_by_modulo),
    Mutation("wrap NaN to NaN", "angles", _ANGLES + "wrap_angle", wrap_anything),
    Mutation("difference not wrapped", "angles", _ANGLES + "angle_difference", subtract_plainly),
    Mutation("mean of numbers", "angles", _ANGLES + "interpolate_angle", interpolate_plainly),
    Mutation(
        "motion by v / omega",
        "motion",
        _FILTER + "motion_model.propagate_pose",
        propagate_by_radius,
    ),
    Mutation(
        "motion by v / omega, guarded",
        "motion",
        _FILTER + "motion_model.propagate_pose",
        propagate_by_radius_guarded,
    ),
    Mutation(
        "motion along the chord",
        "motion",
        _FILTER + "motion_model.propagate_pose",
        propagate_straight,
    ),
    Mutation(
        "S' closed",
        "motion",
        _FILTER + "motion_model.chord_over_arc_derivative",
        derivative_in_closed_form,
    ),
    Mutation(
        "control by distance",
        "motion",
        _FILTER + "motion_model.control_from_odometry",
        control_by_distance,
    ),
    Mutation(
        "range by squares",
        "measurement",
        _FILTER + "ekf.predict_measurement",
        predict_by_squares,
    ),
    Mutation(
        "bearing by acos",
        "measurement",
        _FILTER + "ekf.predict_measurement",
        predict_by_acos,
    ),
    Mutation(
        "residual not wrapped",
        "measurement",
        _FILTER + "ekf.compute_innovation",
        innovation_without_wrap,
    ),
    Mutation(
        "residual not wrapped", "ekf", _FILTER + "ekf.compute_innovation", innovation_without_wrap
    ),
    Mutation(
        "H tan(theta)", "ranging", _LANDMARKS + "candidates.range_from_half_angle", range_by_tangent
    ),
    Mutation(
        "a range above the horizon",
        "ranging",
        _LANDMARKS + "candidates.range_from_half_angle",
        range_without_validity,
    ),
    Mutation("P - K S K^T", "ekf", _FILTER + "ekf._correct", correct_by_subtraction),
    Mutation("(I - K H) P", "ekf", _FILTER + "ekf._correct", correct_by_short_form),
    Mutation("information form by inv", "ekf", _FILTER + "ekf._correct", correct_by_information),
    Mutation("root by Cholesky", "ekf", _FILTER + "ekf.covariance_square_root", root_by_cholesky),
    Mutation(
        "root without pivots", "ekf", _FILTER + "ekf.covariance_square_root", root_without_pivots
    ),
    Mutation("definite up to 1e-9", "ekf", _FILTER + "ekf.covariance_square_root", root_up_to_1e_9),
    Mutation("noise not checked", "ekf", _FILTER + "ekf.covariance_square_root", root_of_anything),
    Mutation("overflow not looked for", "ekf", _FILTER + "ekf._all_finite", always_finite),
    Mutation("NaN not looked for", "ekf", _FILTER + "ekf.is_finite", always_finite),
    Mutation("S + 1e-12 I", "ekf", _FILTER + "ekf._cholesky", cholesky_of_anything),
    Mutation(
        "quantile of 1 - p / 2",
        "trust",
        _FILTER + "ekf.ValidationGate.threshold",
        threshold_of_upper_tail,
    ),
    Mutation("NEES by inv", "trust", _FILTER + "filter_health.nees", nees_by_inverse),
    Mutation(
        "cube root alone",
        "trust",
        _FILTER + "filter_health._chi_square_quantile",
        quantile_by_cube_root,
    ),
    Mutation(
        "ratio divided",
        "likelihood",
        _LANDMARKS + "classifier.likelihood_ratio_test",
        compare_by_division,
    ),
    Mutation(
        "quotients",
        "likelihood",
        _LANDMARKS + "classifier.likelihood_ratio_test",
        compare_by_quotients,
    ),
    Mutation(
        "64-bit products",
        "likelihood",
        _LANDMARKS + "classifier.likelihood_ratio_test",
        compare_in_64_bits,
    ),
    Mutation("totals not checked", "histogram", _LANDMARKS + "classifier._check_total", no_check),
    Mutation(
        "no horizon gate",
        "detector",
        _LANDMARKS + "detector._axis_range_sigma",
        lambda *_: (0.0, True),
    ),
    Mutation(
        "range by a quotient",
        "detector",
        _LANDMARKS + "detector.range_from_slope",
        range_by_quotient,
    ),
]
