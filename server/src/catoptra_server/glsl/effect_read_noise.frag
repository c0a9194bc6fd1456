// Provides the picture with the noise of the amplifier.
// Twin: catoptra_server.effects.sensor.read_noise.ReadNoise.apply.
#include "include/noise.glsl"
uniform sampler2D picture;
uniform float spread;                // standard deviation
uniform uvec3 words;
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    colour = vec4(texelFetch(picture, pixel, 0).rgb + spread * normals(words, pixel), 1.0);
}
