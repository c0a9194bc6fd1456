// Provides the picture as pixels of unequal gain and dark signal measure it.
// Twin: catoptra_server.effects.sensor.fixed_pattern.FixedPattern.apply.
#include "include/noise.glsl"
uniform sampler2D picture;
uniform vec2 spread;                 // standard deviations: of the gain, of the dark signal
uniform uvec3 gain_words;
uniform uvec3 offset_words;
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 gain = 1.0 + spread.x * normals(gain_words, pixel);
    vec3 light = texelFetch(picture, pixel, 0).rgb;
    colour = vec4(light * gain + spread.y * normals(offset_words, pixel), 1.0);
}
