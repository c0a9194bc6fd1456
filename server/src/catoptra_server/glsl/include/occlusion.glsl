// Provides vec3 hidden_sky(vec2 position): the share of hemisphere light that a facet lacks there.
// Twin: catoptra_server.world.shading.OcclusionMap.factors.
uniform sampler2D occlusion_atlas;   // factors, interpolated between nodes by OpenGL

vec3 hidden_sky(vec2 position)      // column and row of the atlas, nodes
{
    return 1.0 - texture(occlusion_atlas, (position + 0.5) / vec2(textureSize(occlusion_atlas, 0))).rgb;
}
