/* Bilinear look-up in linear light. Float64 twin: scene/shading.sample_texture.
 *
 * Texels are stored as sRGB bytes and decoded before they are mixed: textured frames wait for
 * memory, and floats take four times as much of it (49 ms a frame instead of 37 with five textures
 * of 512 px). In a header, for most of a textured frame's time is spent here.
 */
#ifndef CATOPTRA_TEXTURES_H
#define CATOPTRA_TEXTURES_H

#include "kernel.h"
#include "vectors.h"

#include <stddef.h>

/* The four texels around a point, and the point between them. */
typedef struct {
    const uint8_t *upper, *lower; /* left texels of both rows */
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
static inline TexelSquare find_texels(const Texture *texture, float u, float v) {
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

static inline Vec3 decode_texel(const float *linear, const uint8_t *texel) {
    return (Vec3){linear[texel[0]], linear[texel[1]], linear[texel[2]]};
}

/* Linear colour at the point. a + f (b - a) is exact for equal texels. */
static inline Vec3 mix_texels(const float *linear, const TexelSquare *square) {
    Vec3 a = decode_texel(linear, square->upper), b = decode_texel(linear, square->upper + 4);
    Vec3 c = decode_texel(linear, square->lower), d = decode_texel(linear, square->lower + 4);
    Vec3 upper = add(a, scale(square->fx, subtract(b, a)));
    Vec3 lower = add(c, scale(square->fx, subtract(d, c)));
    return add(upper, scale(square->fy, subtract(lower, upper)));
}

#endif
