// Provides float tangent_per_ratio(float ratio_squared): tan(theta/2) over r_i/h of a hyperboloid.
// Twin: catoptra_protocol.optics.mirrors.hyperbolic.HyperbolicMirror.t_from_radius_ratio.
uniform float mirror_kappa_s;        // kappa s: in (0, 1/2], whatever k
uniform float mirror_inverse_s2;     // 1 / s^2

// t = y / (kappa s (1 + sqrt(1 + (y/s)^2))): divided by y it has a value on the axis too, and
// nothing in it cancels or divides by zero.
float tangent_per_ratio(float ratio_squared)
{
    return 1.0 / (mirror_kappa_s * (1.0 + sqrt(1.0 + ratio_squared * mirror_inverse_s2)));
}
