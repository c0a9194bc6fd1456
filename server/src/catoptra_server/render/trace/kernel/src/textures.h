/* Bilinear look-up in linear light. Float64 twin: world/shading.py:sample_texture.
 *
 * Texels are 16-bit linear light: a step is a 40th of a grey level where the sRGB curve is
 * steepest. Bytes and a table of the same light take half the memory and twice the time: those of
 * large scenes' images. In a header, for most of a textured frame's time is spent here.
 */
#ifndef CATOPTRA_TEXTURES_H
#define CATOPTRA_TEXTURES_H

#include "kernel.h"
#include "lanes.h"
#include "vectors.h"

#include <stddef.h>

/* Texel of white. */
#define MAX_TEXEL 65535.0f

/* The four texels around a point, and the point between them. */
typedef struct {
    const uint8_t *upper;  /* left texel of the upper row */
    const float *light;    /* of the level */
    int32_t stride, size;  /* bytes of a row and of a texel */
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

/* Bytes of a texel. */
static inline int32_t texel_size(const Texture *texture, const TextureLevel *level) {
    return texture->channels * (level->light ? 1 : (int32_t)sizeof(uint16_t));
}

/* The left upper one of the texels around a column and a row as by `find_texel`, of rows of
 * `stride` bytes. All are requested from memory. The texture repeats. */
static inline const uint8_t *place_texels(const TextureLevel *level, int32_t size, int32_t stride,
                                          int32_t column, int32_t row) {
    const uint8_t *upper =
        (const uint8_t *)level->texels + (ptrdiff_t)stride * row + size * column;
    __builtin_prefetch(upper);
    __builtin_prefetch(upper + stride);
    return upper;
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
    const TextureLevel *texels = texture->levels + level;
    int32_t size = texel_size(texture, texels);
    TexelSquare square = {.light = texels->light, .stride = size * (texels->width + 2), .size = size};
    int32_t column = find_texel(u, texels->width, &square.fx);
    int32_t row = find_texel(v, texels->height, &square.fy);
    square.upper = place_texels(texels, size, square.stride, column, row);
    return square;
}

typedef float Texel __attribute__((vector_size(16)));
typedef uint16_t TexelBits __attribute__((vector_size(16)));

/* Texels of both rows, one above the other; with the next texel's red in place of an opacity that
 * is not there. */
static inline Floats8 load_texels(const float *light, const uint8_t *upper, const uint8_t *lower) {
    /* 257 times a byte is the same part of 65535. */
    if (__builtin_expect(light != NULL, 0))
        return (Floats8){light[upper[0]], light[upper[1]], light[upper[2]], 257.0f * (float)upper[3],
                         light[lower[0]], light[lower[1]], light[lower[2]], 257.0f * (float)lower[3]};
    uint64_t pair[2];
    TexelBits bits;
    __builtin_memcpy(pair, upper, sizeof *pair);
    __builtin_memcpy(pair + 1, lower, sizeof *pair);
    __builtin_memcpy(&bits, pair, sizeof bits);
    return __builtin_convertvector(bits, Floats8);
}

/* Linear colour, and opacity of four channels, at the point. a + f (b - a) is exact for equal
 * texels. */
static inline Texel mix_texels(const TexelSquare *square) {
    const uint8_t *upper = square->upper, *lower = upper + square->stride;
    Floats8 left = load_texels(square->light, upper, lower);
    Floats8 right = load_texels(square->light, upper + square->size, lower + square->size);
    Floats8 rows = left + square->fx * (right - left);
    Texel above = __builtin_shufflevector(rows, rows, 0, 1, 2, 3);
    Texel below = __builtin_shufflevector(rows, rows, 4, 5, 6, 7);
    return (above + square->fy * (below - above)) * (1.0f / MAX_TEXEL);
}

#endif
