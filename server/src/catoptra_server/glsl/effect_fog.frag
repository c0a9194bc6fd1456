// Provides the image through fog, by the range at each pixel centre.
// Twin: catoptra_server.effects.medium.fog.Fog.apply.
uniform sampler2D image;
uniform sampler2D range_m;           // at the pixel centre; inf for the background
uniform sampler2D mirror_mask;       // 1 where a pixel sees the mirror
uniform float density_per_m;
uniform vec3 airlight;
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float range_m = texelFetch(range_m, pixel, 0).x;
    // Clear air before the background: 0 times infinity is no number.
    float transmittance = density_per_m > 0.0 ? exp(-density_per_m * range_m) : 1.0;
    float absorbed = (1.0 - transmittance) * texelFetch(mirror_mask, pixel, 0).x;
    colour = vec4(texelFetch(image, pixel, 0).rgb * (1.0 - absorbed) + airlight * absorbed, 1.0);
}
