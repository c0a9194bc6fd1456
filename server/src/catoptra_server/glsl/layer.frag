// Provides the samples of an image of layers, for blending.
// Twin: catoptra_server.render.trace.reference.pixels.shade_layers.
#include "include/layer_samples.glsl"
uniform LAYER_SAMPLER layer;
out vec4 colour;

void main()
{
    colour = texelFetch(layer, ivec2(gl_FragCoord.xy), LAYER_SAMPLE);
}
