// Provides the image with each pixel's own gain and dark signal.
// Twin: catoptra_server.effects.sensor.fixed_pattern.FixedPattern.apply.
#include "include/noise.glsl"
uniform sampler2D image;
uniform vec2 standard_deviations;    // of the gain, of the dark signal
uniform uvec3 gain_noise_key;
uniform uvec3 offset_noise_key;
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 gain = 1.0 + standard_deviations.x * normal_variates(gain_noise_key, pixel);
    vec3 radiance = texelFetch(image, pixel, 0).rgb;
    vec3 dark = standard_deviations.y * normal_variates(offset_noise_key, pixel);
    colour = vec4(radiance * gain + dark, 1.0);
}
