#include "measures.h"

#include <math.h>

/* sRGB (IEC 61966-2-1), 0 to 255. */
static float encode_exactly(float linear) {
    float value = clip(linear);
    return 255.0f * (value <= 0.0031308f ? 12.92f * value
                                         : 1.055f * powf(value, 1.0f / 2.4f) - 0.055f);
}

static void note_channel(const FrameState *state, _Atomic float *largest, float one, float other) {
    float known = atomic_load_explicit(largest, memory_order_relaxed);
    /* Each of two rounded levels is half a level off, and a hundredth by the table's steps. */
    int levels = (int)encode(state, one) - (int)encode(state, other);
    if (one == other || fabsf((float)levels) + 1.1f < known)
        return;
    float change = fabsf(encode_exactly(one) - encode_exactly(other));
    while (change > known && !atomic_compare_exchange_weak(largest, &known, change))
        ;
}

void note_change(const FrameState *state, _Atomic float *largest, Vec3 one, Vec3 other) {
    note_channel(state, largest, one.x, other.x);
    note_channel(state, largest, one.y, other.y);
    note_channel(state, largest, one.z, other.z);
}

void note_changes(const FrameState *state, int tile, _Atomic float *largest,
                  const PixelSums *one, const PixelSums *other) {
    float factor = 1.0f / (float)(state->rays->samples * state->rays->samples);
    TilePixels pixels = find_pixels(state, tile);
    for (int row = 0; row < pixels.rows; row++)
        for (int column = 0; column < pixels.columns; column++) {
            int pixel = row * TILE_PX + column;
            note_change(state, largest, scale(factor, get_lane(one->sum, pixel)),
                        scale(factor, get_lane(other->sum, pixel)));
        }
}
