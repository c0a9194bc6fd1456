// Provides the image of a camera displaced from the mirror's focus.
// Twin: catoptra_server.effects.medium.misalignment.Misalignment.apply.
#include "include/bilinear.glsl"
uniform sampler2D image;
uniform sampler2D displacement_px;   // u, v; validity: 1, or 0 for black
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 displacement = texelFetch(displacement_px, pixel, 0).xyz;
    vec3 radiance = sample_bilinear_at_offset(image, pixel, displacement.xy);
    colour = vec4(radiance * displacement.z, 1.0);
}
