/* Bilinear look-up in linear light. Float64 twin: scene/shading.sample_texture. */
#ifndef CATOPTRA_TEXTURES_H
#define CATOPTRA_TEXTURES_H

#include "kernel.h"
#include "vectors.h"

#include <stddef.h>

typedef float Texel __attribute__((vector_size(16)));

/* Index in the bordered texture of the texel before a coordinate; the rest in `fraction`. */
static inline int32_t find_texel(float coordinate, int32_t size, float *fraction) {
    /* Half a texel back to the centre of the texel before, one on for the border. */
    float position = (coordinate - __builtin_floorf(coordinate)) * (float)size + 0.5f;
    /* A coordinate a hair below an integer rounds up to `size`, whose texel the border holds;
     * one that is not a number gives a colour that is none. */
    int32_t texel = position >= 0.0f && position < (float)(size + 1) ? (int32_t)position : 0;
    *fraction = position - (float)texel;
    return texel;
}

static inline Texel load(const float *texels, size_t index) {
    Texel texel;
    __builtin_memcpy(&texel, texels + 4 * index, sizeof texel);
    return texel;
}

/* Linear colour at texture coordinates; the texture repeats. In the header: most of a textured
 * frame's time is spent here. */
static inline Vec3 sample_texture(const Texture *texture, float u, float v) {
    float fx, fy;
    int32_t column = find_texel(u, texture->width, &fx), row = find_texel(v, texture->height, &fy);
    size_t stride = (size_t)texture->width + 2, first = (size_t)row * stride + (size_t)column;
    Texel a = load(texture->texels, first), b = load(texture->texels, first + 1);
    Texel c = load(texture->texels, first + stride), d = load(texture->texels, first + stride + 1);
    /* a + f (b - a), exact for equal texels. */
    Texel upper = a + fx * (b - a), lower = c + fx * (d - c);
    Texel colour = upper + fy * (lower - upper);
    return (Vec3){colour[0], colour[1], colour[2]};
}

#endif
