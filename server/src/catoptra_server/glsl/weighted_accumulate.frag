// Provides a sharp picture by what it counts in each row, to be added up.
// Twin: catoptra_server.capture.shutter.Shutter.weights, times the picture.
uniform sampler2D picture;
uniform sampler2D weights;           // one a row
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    colour = texelFetch(picture, pixel, 0) * texelFetch(weights, ivec2(0, pixel.y), 0).r;
}
