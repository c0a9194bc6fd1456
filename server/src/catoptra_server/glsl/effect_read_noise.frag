// Provides the image with the noise of the amplifier.
// Twin: catoptra_server.effects.sensor.read_noise.ReadNoise.apply.
#include "include/noise.glsl"
uniform sampler2D image;
uniform float standard_deviation;
uniform uvec3 noise_key;
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 noise = standard_deviation * normal_variates(noise_key, pixel);
    colour = vec4(texelFetch(image, pixel, 0).rgb + noise, 1.0);
}
