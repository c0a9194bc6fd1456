// Provides the picture as a camera sees it that stands beside the mirror's focus.
// Twin: catoptra_server.effects.medium.misalignment.Misalignment.apply.
#include "include/bilinear.glsl"
uniform sampler2D picture;
uniform sampler2D lookup_offsets_px;      // how far aside, px; 1, or 0 where nothing is to be seen
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 instead = texelFetch(lookup_offsets_px, pixel, 0).xyz;
    colour = vec4(sample_bilinear_at_offset(picture, pixel, instead.xy) * instead.z, 1.0);
}
