// Provides the picture in which every pixel is the mean of a disc, by its image radius.
// Twin: catoptra_server.effects.defocus.Defocus.apply.
#include "include/disc_kernel.glsl"
uniform sampler2D picture;
uniform sampler2D row;               // of the table, of each pixel's disc
uniform sampler2D weights;
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    colour = vec4(disc_mean(picture, weights, pixel, texelFetch(row, pixel, 0).r), 1.0);
}
