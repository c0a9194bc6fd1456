// Provides vec3 point_irradiance(vec3 offset, vec3 normal): offset from the viewpoint, metres.
// Twin: catoptra_server.world.shading.point_irradiance.
uniform vec3 light_positions[NUM_POINT_LIGHTS];    // relative to the viewpoint, world axes, metres
uniform vec3 light_intensities[NUM_POINT_LIGHTS];  // irradiance at one metre

vec3 point_irradiance(vec3 offset, vec3 normal)
{
    vec3 total = vec3(0.0);
    for (int i = 0; i < NUM_POINT_LIGHTS; ++i) {
        vec3 to_light = light_positions[i] - offset;
        // The inverse square is infinite at the light itself: no distance is below a millimetre.
        float squared = max(dot(to_light, to_light), 1e-6);
        float cosine = max(dot(to_light, normal), 0.0) * inversesqrt(squared);
        total += (cosine / squared) * light_intensities[i];
    }
    return total;
}
