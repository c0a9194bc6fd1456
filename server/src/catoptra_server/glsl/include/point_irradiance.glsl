// Provides vec3 point_irradiance(vec3 place, vec3 normal), place relative to the viewpoint, metres.
// Twin: catoptra_server.scene.shading.point_irradiance.
uniform vec3 light_positions[POINT_LIGHTS];      // relative to the viewpoint, world axes, metres
uniform vec3 light_intensities[POINT_LIGHTS];  // irradiance at one metre

vec3 point_irradiance(vec3 place, vec3 normal)
{
    vec3 total = vec3(0.0);
    for (int i = 0; i < POINT_LIGHTS; ++i) {
        vec3 towards = light_positions[i] - place;
        // At the light itself the inverse square has no value: that of a millimetre instead.
        float squared = max(dot(towards, towards), 1e-6);
        float cosine = max(dot(towards, normal), 0.0) * inversesqrt(squared);
        total += (cosine / squared) * light_intensities[i];
    }
    return total;
}
