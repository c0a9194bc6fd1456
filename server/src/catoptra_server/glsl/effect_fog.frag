// Provides the picture through fog, by the range of what each pixel sees.
// Twin: catoptra_server.effects.medium.fog.Fog.apply.
uniform sampler2D picture;
uniform sampler2D range_m;           // of what the pixel\'s middle sees; inf where nothing is met
uniform sampler2D mirror_mask;       // 1 where a pixel sees the mirror
uniform float density_per_m;
uniform vec3 airlight;
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float range_m = texelFetch(range_m, pixel, 0).x;
    // No fog, and nothing to be seen: 0 times infinity is no number.
    float through = density_per_m > 0.0 ? exp(-density_per_m * range_m) : 1.0;
    float lost = (1.0 - through) * texelFetch(mirror_mask, pixel, 0).x;
    colour = vec4(texelFetch(picture, pixel, 0).rgb * (1.0 - lost) + airlight * lost, 1.0);
}
