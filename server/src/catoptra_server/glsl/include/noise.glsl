// Provides vec3 normals(uvec3 words, ivec2 pixel): a normal number for each colour.
// Twin: catoptra_server.effects.kernels.noise.normals, the same bits.
uniform sampler2D normal_quantile_table;      // 2^16 quantiles, 256 a row

uvec3 hashed(uvec3 v)
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

float normal(uint word)
{
    ivec2 low = ivec2(word & 255u, (word >> 8u) & 255u);
    ivec2 high = ivec2((word >> 16u) & 255u, word >> 24u);
    float sum = texelFetch(normal_quantile_table, low, 0).r + texelFetch(normal_quantile_table, high, 0).r;
    return sum * 0.70710678;
}

vec3 normals(uvec3 words, ivec2 pixel)
{
    uvec3 drawn = hashed(uvec3(uvec2(pixel), 0u) + words);
    return vec3(normal(drawn.x), normal(drawn.y), normal(drawn.z));
}
