// Provides the picture with its red and its blue imaged larger or smaller than its green.
// Twin: catoptra_server.effects.medium.chromatic_aberration.ChromaticAberration.apply.
#include "include/bilinear.glsl"
uniform sampler2D picture;
uniform sampler2D across;            // how far aside columns are read, px: red, blue
uniform sampler2D down;              // and rows
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec2 u = texelFetch(across, ivec2(pixel.x, 0), 0).xy;
    vec2 v = texelFetch(down, ivec2(0, pixel.y), 0).xy;
    float red = sample_bilinear_at_offset(picture, pixel, vec2(u.x, v.x)).r;
    float blue = sample_bilinear_at_offset(picture, pixel, vec2(u.y, v.y)).b;
    colour = vec4(red, texelFetch(picture, pixel, 0).g, blue, 1.0);
}
