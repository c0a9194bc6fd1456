/* Provides sky.h: look-ups in an octahedral map of shared exponents, by vectors.
 * Float64 twin: world/panorama.py. Owns nothing: the map is Python's.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "sky.h"

#include "lanes.h"

#include <string.h>

enum { MANTISSA_BITS = 9, MANTISSA = 511, EXPONENT_BITS = 31, EXPONENT_SHIFT = 27 };

/* Columns and rows of directions in the map, whose middle is up; z points down. */
static inline void find_places(const RayBlock *rays, float size, Floats16 *column, Floats16 *row) {
    Floats16 x = load16(rays->direction[0]), y = load16(rays->direction[1]);
    Floats16 z = load16(rays->direction[2]);
    Floats16 inverse = 1.0f / (absolute16(x) + absolute16(y) + absolute16(z));
    x *= inverse;
    y *= inverse;
    /* Below the horizon the four outer corners of the square, mirrored outwards. */
    Ints16 below = z > 0.0f;
    Floats16 outer_x = 1.0f - absolute16(y), outer_y = 1.0f - absolute16(x);
    outer_x = select16(x < 0.0f, -outer_x, outer_x);
    outer_y = select16(y < 0.0f, -outer_y, outer_y);
    x = select16(below, outer_x, x);
    y = select16(below, outer_y, y);
    /* A border of one texel; rays that are not active may have no direction. */
    Floats16 least = splat16(0.5f), most = splat16(size + 0.5f);
    *column = least16(most16(0.5f * size * x + (0.5f * size + 0.5f), least), most);
    *row = least16(most16(0.5f * size * y + (0.5f * size + 0.5f), least), most);
}

/* Texels at places of a map, and those to the right of them. */
static inline void load_pairs(const uint32_t *map, Ints16 places, Ints16 texels[2]) {
    Longs16 pairs;
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        int64_t pair;
        memcpy(&pair, map + places[lane], sizeof pair);
        pairs[lane] = pair;
    }
    texels[0] = __builtin_convertvector(pairs, Ints16);
    texels[1] = __builtin_convertvector(pairs >> 32, Ints16);
}

/* Light of a texel of each ray, weighted, added to sums. */
static inline void add_texels(Ints16 packed, Floats16 weight, Floats16 sums[3]) {
    /* 2^(e - 24) by its bits: mantissas of 9 bits with an exponent that is biased by 15. */
    weight *= (Floats16)((((packed >> EXPONENT_SHIFT) & EXPONENT_BITS) + (127 - 24)) << 23);
    for (int channel = 0; channel < 3; channel++) {
        Ints16 mantissa = (packed >> (channel * MANTISSA_BITS)) & MANTISSA;
        sums[channel] += weight * __builtin_convertvector(mantissa, Floats16);
    }
}

void show_sky(const Scene *scene, const RayBlock *rays, uint32_t mask,
              float radiance[3][BLOCK_RAYS]) {
    Ints16 is_open = mask16(mask);
    if (!mask)
        return;
    int32_t stride = scene->sky_size + 2;
    Floats16 column, row, sums[3] = {{0}, {0}, {0}};
    find_places(rays, (float)scene->sky_size, &column, &row);
    Ints16 left = __builtin_convertvector(column, Ints16);
    Ints16 top = __builtin_convertvector(row, Ints16);
    Floats16 right_part = column - __builtin_convertvector(left, Floats16);
    Floats16 lower_part = row - __builtin_convertvector(top, Floats16);
    for (int below = 0; below < 2; below++) {
        Ints16 texels[2];
        Floats16 part = below ? lower_part : 1.0f - lower_part;
        load_pairs(scene->sky + below * stride, top * stride + left, texels);
        add_texels(texels[0], part * (1.0f - right_part), sums);
        add_texels(texels[1], part * right_part, sums);
    }
    for (int channel = 0; channel < 3; channel++)
        store16(select16(is_open, sums[channel], load16(radiance[channel])), radiance[channel]);
}
