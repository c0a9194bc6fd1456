// Provides the image rounded to the converter's codes.
// Twin: catoptra_server.effects.sensor.quantisation.Quantisation.apply.
uniform sampler2D image;
uniform float max_code;
out vec4 colour;

void main()
{
    vec3 radiance = texelFetch(image, ivec2(gl_FragCoord.xy), 0).rgb;
    colour = vec4(min(floor(radiance * max_code + 0.5) / max_code, vec3(1.0)), 1.0);
}
