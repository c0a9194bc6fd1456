/* Bilinear look-up in linear light. Float64 twin: world/shading.py:sample_texture.
 *
 * The image is the scene's own array of sRGB bytes, decoded by a table; coarser levels are 16-bit
 * linear light. The table's values have 16 bits, too: a step is a 40th of a grey level where the
 * sRGB curve is steepest. In a header, for most of a textured frame's time is spent here.
 */
#ifndef CATOPTRA_TEXTURES_H
#define CATOPTRA_TEXTURES_H

#include "kernel.h"
#include "vectors.h"

#include <stddef.h>

/* Texel of white. */
#define MAX_TEXEL 65535.0f

/* The four texels around a point, and the point between them. */
typedef struct {
    const uint8_t *upper, *lower; /* left texels of both rows */
    const float *light;           /* of the image's bytes; NULL for texels of 16-bit light */
    int32_t right;                /* bytes from left texels to right ones */
    int32_t channels;
    float fx, fy;
} TexelSquare;

/* Index in the bordered texture of the texel before a coordinate; the rest in `fraction`. */
static inline int32_t find_texel(float coordinate, int32_t size, float *fraction) {
    /* Half a texel back to the centre of the texel before, one on for the border. */
    float position = (coordinate - __builtin_floorf(coordinate)) * (float)size + 0.5f;
    /* A coordinate a hair below an integer rounds up to `size`, whose texel the border holds; one
     * that is not a number gives a colour that is none. */
    int32_t texel = position >= 0.0f && position < (float)(size + 1) ? (int32_t)position : 0;
    *fraction = position - (float)texel;
    return texel;
}

/* Texels around a column and a row as by `find_texel`, requested from memory; `square` has the
 * point between them. The texture repeats. */
static inline void place_texels(const Texture *texture, int32_t level, int32_t column, int32_t row,
                                TexelSquare *square) {
    int32_t width = texture->levels[level].width, height = texture->levels[level].height;
    int32_t right = 1, below = 1, size = texture->channels;
    square->light = level ? NULL : texture->light;
    square->channels = texture->channels;
    if (level) {
        width += 2, size *= (int32_t)sizeof(uint16_t);
    } else {
        /* No border: before the first texel lies the last, behind the last the first. */
        column--, row--;
        if ((uint32_t)column >= (uint32_t)(width - 1))
            column = width - 1, right = 1 - width;
        if ((uint32_t)row >= (uint32_t)(height - 1))
            row = height - 1, below = 1 - height;
    }
    ptrdiff_t stride = (ptrdiff_t)size * width;
    square->right = size * right;
    square->upper = (const uint8_t *)texture->levels[level].texels + row * stride + column * size;
    square->lower = square->upper + below * stride;
    __builtin_prefetch(square->upper);
    __builtin_prefetch(square->lower);
}

/* A coordinate between the centres of the first and of the last texel. */
static inline float clamp_coordinate(float coordinate, int32_t size) {
    float half = 0.5f / (float)size, last = 1.0f - half;
    return coordinate < half ? half : coordinate < last ? coordinate : last;
}

static inline float snap_coordinate(float coordinate, int32_t size) {
    return (__builtin_floorf(coordinate * (float)size) + 0.5f) / (float)size;
}

/* Coordinates at which a look-up that repeats and interpolates gives that of the texture. */
static inline void adjust_coordinates(const Texture *texture, int32_t level, int is_image,
                                      float *u, float *v) {
    int32_t width = texture->levels[level].width, height = texture->levels[level].height;
    if (is_image && texture->sampling & SAMPLE_NEAREST) {
        *u = snap_coordinate(*u, width);
        *v = snap_coordinate(*v, height);
    }
    *u = texture->sampling & SAMPLE_CLAMP_U ? clamp_coordinate(*u, width) : *u;
    *v = texture->sampling & SAMPLE_CLAMP_V ? clamp_coordinate(*v, height) : *v;
}

/* Texels around coordinates, by the texture's own way to continue and to interpolate. */
static inline TexelSquare sample_texels(const Texture *texture, int32_t level, float u, float v,
                                        int is_image) {
    if (__builtin_expect(texture->sampling, 0))
        adjust_coordinates(texture, level, is_image, &u, &v);
    TexelSquare square;
    int32_t column = find_texel(u, texture->levels[level].width, &square.fx);
    int32_t row = find_texel(v, texture->levels[level].height, &square.fy);
    place_texels(texture, level, column, row, &square);
    return square;
}

typedef float Texel __attribute__((vector_size(16)));
typedef uint16_t TexelBits __attribute__((vector_size(8)));

/* Without opacity. */
static inline Texel load_image_texel(const float *light, const uint8_t *bytes) {
    return (Texel){light[bytes[0]], light[bytes[1]], light[bytes[2]], 0.0f};
}

/* With the next texel's red in place of an opacity that is not there. */
static inline Texel load_coarse_texel(const uint8_t *texel) {
    TexelBits bits;
    __builtin_memcpy(&bits, texel, sizeof bits);
    return __builtin_convertvector(bits, Texel);
}

/* Linear colour and opacity at the point. a + f (b - a) is exact for equal texels. */
static inline Texel mix_texels(const TexelSquare *square) {
    const uint8_t *at[4] = {square->upper, square->upper + square->right, square->lower,
                            square->lower + square->right};
    Texel a, b, c, d;
    if (square->light) {
        a = load_image_texel(square->light, at[0]), b = load_image_texel(square->light, at[1]);
        c = load_image_texel(square->light, at[2]), d = load_image_texel(square->light, at[3]);
        /* 257 times a byte is the same part of 65535. */
        if (__builtin_expect(square->channels == 4, 0)) {
            a[3] = 257.0f * (float)at[0][3], b[3] = 257.0f * (float)at[1][3];
            c[3] = 257.0f * (float)at[2][3], d[3] = 257.0f * (float)at[3][3];
        }
    } else {
        a = load_coarse_texel(at[0]), b = load_coarse_texel(at[1]);
        c = load_coarse_texel(at[2]), d = load_coarse_texel(at[3]);
    }
    Texel upper = a + square->fx * (b - a), lower = c + square->fx * (d - c);
    Texel mixed = (upper + square->fy * (lower - upper)) * (1.0f / MAX_TEXEL);
    if (square->channels == 3)
        mixed[3] = 1.0f;
    return mixed;
}

#endif
