// Provides the picture in a mirror of metal, whose reflectance depends on the angle of light.
// Twin: catoptra_server.effects.mirror.mirror_reflectance.MirrorReflectance.apply.
const int STEPS = 200;
uniform sampler2D picture;
uniform vec2 centre_px;
uniform float rim_px;
uniform float gains[STEPS + 1];      // at equal steps of the radius, from the centre to the rim
out vec4 colour;

void main()
{
    float place = min(length(gl_FragCoord.xy - centre_px) / rim_px, 1.0) * float(STEPS);
    int below = min(int(place), STEPS - 1);
    float gain = mix(gains[below], gains[below + 1], place - float(below));
    colour = texelFetch(picture, ivec2(gl_FragCoord.xy), 0) * gain;
}
