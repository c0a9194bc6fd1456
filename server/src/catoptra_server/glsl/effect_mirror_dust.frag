// Provides the image in a mirror with dust and scratches.
// Twin: catoptra_server.effects.mirror.mirror_dust.MirrorDust.apply.
uniform sampler2D image;
uniform sampler2D coverage;          // fraction of each pixel's view
uniform float scattered_radiance;    // of the contaminants
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 radiance = texelFetch(image, pixel, 0).rgb;
    float fraction = texelFetch(coverage, pixel, 0).r;
    colour = vec4(radiance + fraction * (scattered_radiance - radiance), 1.0);
}
