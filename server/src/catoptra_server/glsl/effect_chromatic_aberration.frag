// Provides the image with red and blue magnified differently from green.
// Twin: catoptra_server.effects.medium.chromatic_aberration.ChromaticAberration.apply.
#include "include/bilinear.glsl"
uniform sampler2D image;
uniform sampler2D column_offsets_px; // of red and blue, for each column
uniform sampler2D row_offsets_px;    // of red and blue, for each row
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec2 u = texelFetch(column_offsets_px, ivec2(pixel.x, 0), 0).xy;
    vec2 v = texelFetch(row_offsets_px, ivec2(0, pixel.y), 0).xy;
    float red = sample_bilinear_at_offset(image, pixel, vec2(u.x, v.x)).r;
    float blue = sample_bilinear_at_offset(image, pixel, vec2(u.y, v.y)).b;
    colour = vec4(red, texelFetch(image, pixel, 0).g, blue, 1.0);
}
