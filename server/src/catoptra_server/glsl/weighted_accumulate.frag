// Provides a sharp image times the weight of each row, for additive blending.
// Twin: catoptra_server.world.objects.Shutter.row_weights, times the image.
uniform sampler2D image;
uniform sampler2D weights;           // one texel a row
out vec4 colour;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    colour = texelFetch(image, pixel, 0) * texelFetch(weights, ivec2(0, pixel.y), 0).r;
}
