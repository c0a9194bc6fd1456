// Provides the picture in which every pixel is the mean of a disc, by its image radius and range.
// Twin: catoptra_server.effects.medium.defocus_by_depth.DefocusByDepth.apply.
#include "include/disc_kernel.glsl"
const float LEAST_NEARNESS = 1e-6;
uniform sampler2D picture;
uniform sampler2D range_m;           // of what the pixel\'s middle sees; inf where nothing is met
uniform sampler2D law;               // of the disc: fixed_px, near_px, power_per_m, offset
uniform sampler2D weights;
uniform vec2 centre_px;
uniform float integer_px;              // up to there pixels see the mirror wholly
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 disc = texelFetch(law, pixel, 0);
    float range_m = texelFetch(range_m, pixel, 0).r;
    float nearness = max(disc.z * range_m + disc.w, LEAST_NEARNESS);
    float added_px = isinf(range_m) ? 0.0 : disc.y / nearness;
    Region region = Region(centre_px, integer_px);
    float row = row_of(disc.x + added_px);
    colour = vec4(disc_mean(picture, region, weights, pixel, row), 1.0);
}
