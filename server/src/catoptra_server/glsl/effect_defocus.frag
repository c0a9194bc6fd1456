// Provides the image with every pixel the mean of a disc, by its image radius.
// Twin: catoptra_server.effects.medium.defocus.Defocus.apply.
#include "include/disc_kernel.glsl"
uniform sampler2D image;
uniform sampler2D kernel_row;        // fractional row of the table for each pixel
uniform sampler2D weights;
uniform vec2 centre_px;
uniform float full_view_radius_px;   // pixels within see the mirror with their whole square
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    Region region = Region(centre_px, full_view_radius_px);
    float row = texelFetch(kernel_row, pixel, 0).r;
    colour = vec4(disc_mean(image, region, weights, pixel, row), 1.0);
}
