// Provides the image with the noise of photons, clipped at the full well.
// Twin: catoptra_server.effects.sensor.shot_noise.ShotNoise.apply.
#include "include/noise.glsl"
uniform sampler2D image;
uniform float radiance_per_electron;
uniform uvec3 noise_key;
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 radiance = texelFetch(image, pixel, 0).rgb;
    vec3 deviation = sqrt(max(radiance, vec3(0.0)) * radiance_per_electron);
    colour = vec4(min(radiance + deviation * normal_variates(noise_key, pixel), vec3(1.0)), 1.0);
}
