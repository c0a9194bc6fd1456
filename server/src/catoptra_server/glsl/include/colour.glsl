// Provides vec3 srgb_from_linear(vec3 linear): encoded values, light outside [0, 1] clipped.
// Twin: catoptra_server.scene.colour.srgb_from_linear.
vec3 srgb_from_linear(vec3 linear)
{
    vec3 light = clamp(linear, 0.0, 1.0);
    vec3 curved = 1.055 * pow(max(light, vec3(0.0031308)), vec3(1.0 / 2.4)) - 0.055;
    return mix(curved, 12.92 * light, lessThanEqual(light, vec3(0.0031308)));
}
