// Provides vec3 srgb_from_linear(vec3 linear): encoded values, light outside [0, 1] clipped.
// Twin: catoptra_server.world.world_description.srgb_from_linear.

// The power 1 / 2.4 as a sum of powers that square roots make, fitted to a thousandth of a grey
// level: on processors a root costs a fraction of a power.
vec3 srgb_from_linear(vec3 linear)
{
    vec3 light = clamp(linear, 0.0, 1.0);
    vec3 half_power = sqrt(light);
    vec3 quarter = sqrt(half_power);
    vec3 eighth = sqrt(quarter);
    vec3 curved = -0.0647683664 + 0.186680229 * half_power - 0.295837138 * quarter
                + eighth * (0.0799698057 + 1.09395785 * quarter);
    return mix(curved, 12.92 * light, lessThanEqual(light, vec3(0.0031308)));
}
