// Provides direction and validity of input_0.xy, a pixel.
// Twin: catoptra_protocol.optics.camera.direction_from_pixel.
uniform sampler2D input_0;
out vec4 result;

void main()
{
    vec3 direction;
    bool valid = direction_from_pixel(texelFetch(input_0, ivec2(gl_FragCoord.xy), 0).xy, direction);
    result = vec4(direction, valid ? 1.0 : 0.0);
}
