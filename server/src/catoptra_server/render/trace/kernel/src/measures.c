/* Provides measures.h: maxima of the changes that effects make.
 * Float64 twin: reference/reference_engine.py, the difference of two frames. Owns nothing: the
 * measures are the frame's.
 * Threads: any thread at once: maxima are atomic. */
#include "measures.h"

#include "encoding.h"
#include "image_vectors.h"

#include <math.h>

/* Twice the table's error: of the difference of two levels. */
#define TABLE_ERROR 0.01f

float spilt_levels(const Frame *frame, float larger, float difference) {
    float excess = frame->spill[0] * larger - 1.0f, change = frame->spill[0] * difference;
    return encode_level(frame->spill[1] * (change < excess ? change : excess));
}

/* On its way to the picture light is multiplied by any of the frame's gains: a difference shows most
 * where the larger value just reaches white. */
float level_change(const Frame *frame, float one, float other) {
    float larger = one > other ? one : other, gain = frame->largest_gain;
    if (one == other)
        return 0.0f;
    if (gain * larger > 1.0f)
        gain = 1.0f / larger > frame->least_gain ? 1.0f / larger : frame->least_gain;
    float change = fabsf(encode_level(gain * one) - encode_level(gain * other));
    return fminf(change + spilt_levels(frame, larger, fabsf(one - other)), 255.0f);
}

void note_level_change(const Frame *frame, _Atomic float *largest, float one, float other) {
    float known = atomic_load_explicit(largest, memory_order_relaxed);
    float change = level_change(frame, one, other);
    while (change > known && !atomic_compare_exchange_weak(largest, &known, change))
        ;
}

void note_change(const Frame *frame, _Atomic float *largest, Vec3 one, Vec3 other) {
    note_level_change(frame, largest, one.x, other.x);
    note_level_change(frame, largest, one.y, other.y);
    note_level_change(frame, largest, one.z, other.z);
}

/* Upper bound of the change of 16 pixels, grey levels: the curve is concave, so that a difference
 * shows most where it begins at the darkest value; of what reaches beyond white, below white. */
static float bound_change(const Frame *frame, float factor, const float *one, const float *other) {
    Floats16 a = factor * load16(one), b = factor * load16(other);
    float change = largest_of(most16(a, b) - least16(a, b));
    float spilt = spilt_levels(frame, largest_of(most16(a, b)), change);
    float lowest = clip(frame->largest_gain * smallest_of(least16(a, b)));
    float difference = clip(frame->largest_gain * change);
    if (lowest + difference > 1.0f)
        lowest = 1.0f - difference;
    return encode_level(lowest + difference) - encode_level(lowest) + TABLE_ERROR + spilt;
}

static void note_pixels(const Frame *frame, const TilePixels *pixels, _Atomic float *largest,
                        float factor, const float *one, const float *other) {
    if (bound_change(frame, factor, one, other) <=
        atomic_load_explicit(largest, memory_order_relaxed))
        return;
    for (int row = 0; row < pixels->rows; row++)
        for (int column = 0; column < pixels->columns; column++) {
            int pixel = row * TILE_PX + column;
            note_level_change(frame, largest, factor * one[pixel], factor * other[pixel]);
        }
}

void note_changes(const FrameState *state, int tile, _Atomic float *largest,
                  const PixelSums *one, const PixelSums *other) {
    float factor = 1.0f / (float)(state->rays->samples * state->rays->samples);
    TilePixels pixels = find_pixels(state, tile);
    for (int channel = 0; channel < 3; channel++)
        note_pixels(state->frame, &pixels, largest, factor, one->sum[channel], other->sum[channel]);
}
