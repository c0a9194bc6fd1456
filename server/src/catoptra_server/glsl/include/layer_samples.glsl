// Provides the type of an image with the samples of this fragment's texel, and the sample's number.
// Twin: none, a name.
#ifdef MULTISAMPLED
#extension GL_ARB_sample_shading : require
#define LAYER_SAMPLER sampler2DMS
#define LAYER_SAMPLE gl_SampleID     // reading it, a program runs for each sample
#else
#define LAYER_SAMPLER sampler2D
#define LAYER_SAMPLE 0
#endif
