/* Provides measures.h: the changes that effects make.
 * Float64 twin: reference/reference_engine.py, the difference of two frames. Owns nothing: the
 * measures are the frame's.
 * Threads: any thread at once. */
#include "measures.h"

#include "encoding.h"
#include "lanes.h"

#include <math.h>

/* Twice the table's error: of the difference of two levels. */
#define TABLE_ERROR 0.01f
#define SQRT_HALF 0.7071f

float spilt_levels(const Frame *frame, float larger, float difference) {
    float excess = frame->spill[0] * larger - 1.0f, change = frame->spill[0] * difference;
    return encode_level(frame->spill[1] * (change < excess ? change : excess));
}

/* On its way to the picture light is multiplied by any of the frame's gains: a difference shows
 * most where the larger value just reaches white. */
float level_change(const Frame *frame, float one, float other) {
    float larger = one > other ? one : other, gain = frame->largest_gain;
    if (one == other)
        return 0.0f;
    if (gain * larger > 1.0f)
        gain = 1.0f / larger > frame->least_gain ? 1.0f / larger : frame->least_gain;
    float change = fabsf(encode_level(gain * one) - encode_level(gain * other));
    return fminf(change + spilt_levels(frame, larger, fabsf(one - other)), 255.0f);
}

float unseen_levels(const FrameState *state, const ChangeMeasure *measure) {
    int is_shadow = measure == &state->measures->shadow;
    float unseen = is_shadow ? UNSEEN_PART * state->frame->limits.plain_change : 0.0f;
    /* Two samples of which one is beyond white: `find_light_change`. */
    if (measure == &state->measures->light || measure == &state->measures->bright)
        unseen = (1.0f - SQRT_HALF) * VISIBLE_LEVELS;
    return unseen < VISIBLE_LEVELS ? VISIBLE_LEVELS - unseen : 0.0f;
}

PixelChange find_light_change(const FrameState *state, int pixels) {
    const ChangeMeasure *light = &state->measures->light;
    float all = read_largest(light), bright = read_largest(&state->measures->bright);
    float spilt = read_largest(&state->measures->spilt);
    PixelChange change = conclude_change(light, &state->frame->limits, pixels);
    change.largest = fminf(sqrtf(all * all + bright * bright) + spilt, 255.0f);
    if (spilt > 0.0f)
        change.num_visible = pixels;
    return change;
}

void end_measures(const FrameState *state) {
    struct Measures *measures = state->measures;
    const ChangeLimits *limits = &state->frame->limits;
    if (!is_counted(&measures->shadow, limits))
        measures->ended |= MEASURE_SHADOWS;
    if (!is_counted(&measures->light, limits))
        measures->ended |= MEASURE_LIGHT;
    if (!is_counted(&measures->watched, limits))
        measures->ended |= MEASURE_WATCHED;
}

float colour_change(const Frame *frame, Vec3 one, Vec3 other) {
    return fmaxf(fmaxf(level_change(frame, one.x, other.x), level_change(frame, one.y, other.y)),
                 level_change(frame, one.z, other.z));
}

/* Note the change of some pixels, whose brightest light is known. */
static void note_levels(const FrameState *state, ChangeMeasure *measure, int pixels, float change,
                        float brightest) {
    raise_largest(measure, change);
    if (change <= unseen_levels(state, measure))
        return;
    count_visible(measure, pixels);
    if (spilt_levels(state->frame, brightest, brightest) > VISIBLE_LEVELS)
        atomic_store_explicit(&measure->spills, 1, memory_order_relaxed);
}

static float brighter(Vec3 one, Vec3 other) {
    return fmaxf(fmaxf(fmaxf(one.x, other.x), fmaxf(one.y, other.y)), fmaxf(one.z, other.z));
}

void note_change(const FrameState *state, ChangeMeasure *measure, int pixels, Vec3 one,
                 Vec3 other) {
    note_levels(state, measure, pixels, colour_change(state->frame, one, other),
                brighter(one, other));
}

/* Upper bound of the change of 16 pixels, grey levels: the curve is concave, so that a difference
 * shows most where it begins at the darkest value; of what reaches beyond white, below white. */
static float bound_change(const Frame *frame, float factor, const float *one, const float *other) {
    Floats16 a = factor * load16(one), b = factor * load16(other);
    float change = most_of16(most16(a, b) - least16(a, b));
    float spilt = spilt_levels(frame, most_of16(most16(a, b)), change);
    float lowest = clip(frame->largest_gain * least_of16(least16(a, b)));
    float difference = clip(frame->largest_gain * change);
    if (lowest + difference > 1.0f)
        lowest = 1.0f - difference;
    return encode_level(lowest + difference) - encode_level(lowest) + TABLE_ERROR + spilt;
}

static Vec3 mean_of(const PixelSums *sums, int pixel, float factor) {
    return (Vec3){factor * sums->sum[0][pixel], factor * sums->sum[1][pixel],
                  factor * sums->sum[2][pixel]};
}

void note_largest_changes(const FrameState *state, int tile, ChangeMeasure *measure, int pairs,
                          const PixelSums *const *one, const PixelSums *const *other) {
    const Frame *frame = state->frame;
    float factor = 1.0f / (float)(state->rays->samples * state->rays->samples), bound = 0.0f;
    for (int pair = 0; pair < pairs; pair++)
        for (int channel = 0; channel < 3; channel++)
            bound = fmaxf(bound, bound_change(frame, factor, one[pair]->sum[channel],
                                              other[pair]->sum[channel]));
    int counts = bound > unseen_levels(state, measure) && is_counted(measure, &frame->limits);
    if (bound <= read_largest(measure) && !counts)
        return;
    TilePixels pixels = find_pixels(state, tile);
    for (int row = 0; row < pixels.rows; row++)
        for (int column = 0; column < pixels.columns; column++) {
            int pixel = row * TILE_PX + column;
            float change = 0.0f, brightest = 0.0f;
            for (int pair = 0; pair < pairs; pair++) {
                Vec3 before = mean_of(one[pair], pixel, factor);
                Vec3 after = mean_of(other[pair], pixel, factor);
                change = fmaxf(change, colour_change(frame, before, after));
                brightest = fmaxf(brightest, brighter(before, after));
            }
            note_levels(state, measure, 1, change, brightest);
        }
}

void note_changes(const FrameState *state, int tile, ChangeMeasure *measure, const PixelSums *one,
                  const PixelSums *other) {
    note_largest_changes(state, tile, measure, 1, &one, &other);
}

/* Whether no change of some samples is larger than the largest so far, where nobody counts pixels
 * any more: a concave curve that begins at 0 grows by no more than from there. */
static int is_smaller(const FrameState *state, const ChangeMeasure *measure, uint32_t lanes,
                      float one[3][BLOCK_RAYS], float other[3][BLOCK_RAYS]) {
    const Frame *frame = state->frame;
    if (is_counted(measure, &frame->limits))
        return 0;
    Floats16 changes = splat16(0.0f);
    for (int channel = 0; channel < 3; channel++)
        changes = most16(absolute16(load16(one[channel]) - load16(other[channel])), changes);
    float most = most_of16(select16(mask16(lanes), changes, splat16(0.0f)));
    float spilt = frame->spill[1] > 0.0f ? encode_level(frame->spill[0] * frame->spill[1] * most) : 0;
    return encode_level(frame->largest_gain * most) + spilt + TABLE_ERROR <= read_largest(measure);
}

void note_samples(const FrameState *state, ChangeMeasure *measure, uint32_t lanes,
                  float one[3][BLOCK_RAYS], float other[3][BLOCK_RAYS]) {
    float largest = 0.0f, brightest = 0.0f, bound = 0.0f;
    int visible = 0;
    if (is_smaller(state, measure, lanes, one, other))
        return;
    for (int channel = 0; channel < 3; channel++) {
        _Alignas(64) float before[BLOCK_RAYS], after[BLOCK_RAYS];
        Floats16 any = splat16(one[channel][__builtin_ctz(lanes)]);
        store16(select16(mask16(lanes), load16(one[channel]), any), before);
        store16(select16(mask16(lanes), load16(other[channel]), load16(before)), after);
        bound = fmaxf(bound, bound_change(state->frame, 1.0f, before, after));
    }
    if (bound <= read_largest(measure) && bound <= unseen_levels(state, measure))
        return;
    for (; lanes; lanes &= lanes - 1) {
        int lane = __builtin_ctz(lanes);
        Vec3 before = get_lane(one, lane), after = get_lane(other, lane);
        float change = colour_change(state->frame, before, after);
        visible += change > unseen_levels(state, measure);
        largest = fmaxf(largest, change);
        brightest = fmaxf(brightest, brighter(before, after));
    }
    note_levels(state, measure, visible, largest, brightest);
}
