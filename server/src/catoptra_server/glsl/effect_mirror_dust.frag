// Provides the picture in a mirror with dust and scratches on it.
// Twin: catoptra_server.effects.mirror.mirror_dust.MirrorDust.apply.
uniform sampler2D picture;
uniform sampler2D covered;           // the share of each pixel's view
uniform float scattered;             // the light of what covers it
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 light = texelFetch(picture, pixel, 0).rgb;
    float share = texelFetch(covered, pixel, 0).r;
    colour = vec4(light + share * (scattered - light), 1.0);
}
