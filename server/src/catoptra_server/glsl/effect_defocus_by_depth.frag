// Provides the image with every pixel the mean of a disc, by its image radius and range.
// Twin: catoptra_server.effects.medium.defocus_by_depth.DefocusByDepth.apply.
#include "include/disc_kernel.glsl"
const float MIN_DENOMINATOR = 1e-6;  // of kernels/lens_blur
uniform sampler2D image;
uniform sampler2D range_m;           // at the pixel centre; inf for the background
uniform sampler2D disc_parameters;   // infinity_diameter_px, near_px, power_per_m, offset
uniform sampler2D weights;
uniform vec2 centre_px;
uniform float full_view_radius_px;   // pixels within see the mirror with their whole square
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 disc = texelFetch(disc_parameters, pixel, 0);
    float range_m = texelFetch(range_m, pixel, 0).r;
    float denominator = max(disc.z * range_m + disc.w, MIN_DENOMINATOR);
    // GLSL 3.30 does not promise that a finite number over infinity is 0.
    float near_term_px = isinf(range_m) ? 0.0 : disc.y / denominator;
    Region region = Region(centre_px, full_view_radius_px);
    float row = kernel_row_of_diameter(disc.x + near_term_px);
    colour = vec4(disc_mean(image, region, weights, pixel, row), 1.0);
}
