// Provides the image times one gain.
// Twin: catoptra_server.effects.sensor.auto_exposure.AutoExposure.apply.
uniform sampler2D image;
uniform float gain;
out vec4 colour;

void main()
{
    colour = texelFetch(image, ivec2(gl_FragCoord.xy), 0) * gain;
}
