// Provides the picture with the noise of photons, clipped at the full well.
// Twin: catoptra_server.effects.sensor.shot_noise.ShotNoise.apply.
#include "include/noise.glsl"
uniform sampler2D picture;
uniform float electron;              // the light of one
uniform uvec3 words;
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 light = texelFetch(picture, pixel, 0).rgb;
    vec3 spread = sqrt(max(light, vec3(0.0)) * electron);
    colour = vec4(min(light + spread * normals(words, pixel), vec3(1.0)), 1.0);
}
