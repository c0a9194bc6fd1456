/* Bilinear look-up in linear light. Float64 twin: world/shading.py:sample_texture.
 *
 * Texels are 16-bit linear light: a step is a 40th of a grey level where the sRGB curve is
 * steepest. The image's own bytes and a table take half the memory, and twice the time. In a
 * header, for most of a textured frame's time is spent here.
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
    const uint16_t *upper;    /* left texel of the upper row */
    int32_t stride, channels; /* numbers of a row and of a texel */
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
static inline void place_texels(const Texture *texture, const TextureLevel *level, int32_t column,
                                int32_t row, TexelSquare *square) {
    square->channels = texture->channels;
    square->stride = square->channels * (level->width + 2);
    square->upper = level->texels + (ptrdiff_t)square->stride * row + square->channels * column;
    __builtin_prefetch(square->upper);
    __builtin_prefetch(square->upper + square->stride);
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
    place_texels(texture, texture->levels + level, column, row, &square);
    return square;
}

typedef float Texel __attribute__((vector_size(16)));
typedef uint16_t TexelBits __attribute__((vector_size(16)));

/* Texels of both rows, one above the other; with the next texel's red in place of an opacity that
 * is not there. */
static inline Floats8 load_texels(const uint16_t *upper, const uint16_t *lower) {
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
    const uint16_t *upper = square->upper, *lower = upper + square->stride;
    Floats8 left = load_texels(upper, lower);
    Floats8 right = load_texels(upper + square->channels, lower + square->channels);
    Floats8 rows = left + square->fx * (right - left);
    Texel above = __builtin_shufflevector(rows, rows, 0, 1, 2, 3);
    Texel below = __builtin_shufflevector(rows, rows, 4, 5, 6, 7);
    return (above + square->fy * (below - above)) * (1.0f / MAX_TEXEL);
}

#endif
