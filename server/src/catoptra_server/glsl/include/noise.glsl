// Provides vec3 normal_variates(uvec3 key, ivec2 pixel): one normal variate for each colour.
// Twin: catoptra_server.effects.kernels.noise.normal_variates, the same bits.
uniform sampler2D normal_quantile_table; // 2^16 quantiles, 256 a row

uvec3 pcg3d(uvec3 v)
{
    v = v * 1664525u + 1013904223u;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v ^= v >> 16u;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    return v;
}

float normal_variate(uint word)
{
    ivec2 low = ivec2(word & 255u, (word >> 8u) & 255u);
    ivec2 high = ivec2((word >> 16u) & 255u, word >> 24u);
    float sum = texelFetch(normal_quantile_table, low, 0).r
              + texelFetch(normal_quantile_table, high, 0).r;
    return sum * 0.70710678;
}

vec3 normal_variates(uvec3 key, ivec2 pixel)
{
    uvec3 words = pcg3d(uvec3(uvec2(pixel), 0u) + key);
    return vec3(normal_variate(words.x), normal_variate(words.y), normal_variate(words.z));
}
