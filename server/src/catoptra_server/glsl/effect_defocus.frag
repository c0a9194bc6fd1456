// Provides the picture in which every pixel is the mean of a disc, by its image radius.
// Twin: catoptra_server.effects.medium.defocus.Defocus.apply.
#include "include/disc_kernel.glsl"
uniform sampler2D picture;
uniform sampler2D row;               // of the table, of each pixel's disc
uniform sampler2D weights;
uniform vec2 centre_px;
uniform float integer_px;              // up to there pixels see the mirror wholly
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    Region region = Region(centre_px, integer_px);
    float own_row = texelFetch(row, pixel, 0).r;
    colour = vec4(disc_mean(picture, region, weights, pixel, own_row), 1.0);
}
