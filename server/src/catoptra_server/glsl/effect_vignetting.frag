// Provides the image darkened by cos^4 of the angle at the lens.
// Twin: catoptra_server.effects.medium.vignetting.Vignetting.apply.
uniform sampler2D image;
uniform vec2 centre_px;
uniform float inverse_focal_length;  // tan(psi) of a radius of one pixel
out vec4 colour;

void main()
{
    vec2 tangent = (gl_FragCoord.xy - centre_px) * inverse_focal_length;
    float secant2 = 1.0 + dot(tangent, tangent);
    colour = texelFetch(image, ivec2(gl_FragCoord.xy), 0) / (secant2 * secant2);
}
