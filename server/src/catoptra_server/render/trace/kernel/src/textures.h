/* Bilinear look-up in linear light. Float64 twin: world/shading.py:sample_texture.
 *
 * Texels are 16-bit linear light: textured frames wait for memory, of which floats take twice as
 * much, and sRGB bytes would have to be decoded one by one. A step is a 40th of a grey level where
 * the sRGB curve is steepest. In a header, for most of a textured frame's time is spent here.
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
    const uint16_t *upper, *lower; /* left texels of both rows */
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

/* Texels around texture coordinates, requested from memory; the texture repeats. */
static inline TexelSquare find_texels(const TextureLevel *texture, float u, float v) {
    TexelSquare square;
    size_t stride = (size_t)texture->width + 2;
    size_t column = (size_t)find_texel(u, texture->width, &square.fx);
    size_t row = (size_t)find_texel(v, texture->height, &square.fy);
    square.upper = texture->texels + 4 * (row * stride + column);
    square.lower = square.upper + 4 * stride;
    __builtin_prefetch(square.upper);
    __builtin_prefetch(square.lower);
    return square;
}

/* A coordinate between the centres of the first and of the last texel. */
static inline float clamp_coordinate(float coordinate, int32_t size) {
    float half = 0.5f / (float)size, last = 1.0f - half;
    return coordinate < half ? half : coordinate < last ? coordinate : last;
}

static inline float snap_coordinate(float coordinate, int32_t size) {
    return (__builtin_floorf(coordinate * (float)size) + 0.5f) / (float)size;
}

/* Texels around coordinates, by the texture's own way to continue and to interpolate. */
static inline TexelSquare sample_texels(const Texture *texture, const TextureLevel *level, float u,
                                        float v, int is_image) {
    if (__builtin_expect(texture->sampling, 0)) {
        if (is_image && texture->sampling & SAMPLE_NEAREST) {
            u = snap_coordinate(u, level->width);
            v = snap_coordinate(v, level->height);
        }
        u = texture->sampling & SAMPLE_CLAMP_U ? clamp_coordinate(u, level->width) : u;
        v = texture->sampling & SAMPLE_CLAMP_V ? clamp_coordinate(v, level->height) : v;
    }
    return find_texels(level, u, v);
}

typedef float Texel __attribute__((vector_size(16)));
typedef uint16_t TexelBits __attribute__((vector_size(8)));

static inline Texel load_texel(const uint16_t *texel) {
    TexelBits bits;
    __builtin_memcpy(&bits, texel, sizeof bits);
    return __builtin_convertvector(bits, Texel);
}

/* Linear colour at the point. a + f (b - a) is exact for equal texels. */
static inline Texel mix_texels(const TexelSquare *square) {
    Texel a = load_texel(square->upper), b = load_texel(square->upper + 4);
    Texel c = load_texel(square->lower), d = load_texel(square->lower + 4);
    Texel upper = a + square->fx * (b - a), lower = c + square->fx * (d - c);
    return (upper + square->fy * (lower - upper)) * (1.0f / MAX_TEXEL);
}

#endif
