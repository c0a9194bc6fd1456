// Provides the image darkened towards its border, by image radius.
// Twin: catoptra_server.effects.medium.vignetting.Vignetting.apply.
const int STEPS = 200;               // of medium/vignetting
uniform sampler2D image;
uniform vec2 centre_px;
uniform float rim_px;
uniform float gains[STEPS + 1];      // at equal steps of the radius, from the centre to the rim
out vec4 colour;

void main()
{
    float position = min(length(gl_FragCoord.xy - centre_px) / rim_px, 1.0) * float(STEPS);
    int below = min(int(position), STEPS - 1);
    float gain = mix(gains[below], gains[below + 1], position - float(below));
    colour = texelFetch(image, ivec2(gl_FragCoord.xy), 0) * gain;
}
