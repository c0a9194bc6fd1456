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
    if (!(frame->spill[1] > 0.0f))
        return 0.0f;
    return encode_level(frame->spill[1] * (change < excess ? change : excess));
}

static inline Floats16 encode16(Floats16 light) {
    _Alignas(64) float linear[BLOCK_RAYS], encoded[BLOCK_RAYS];
    store16(light, linear);
    encode_levels(linear, encoded);
    return load16(encoded);
}

/* On its way to the picture light is multiplied by any of the frame's gains: a difference shows
 * most where the larger value just reaches white. */
static inline Floats16 level_changes(const Frame *frame, Floats16 one, Floats16 other) {
    Floats16 larger = most16(one, other), difference = absolute16(one - other);
    Floats16 least = splat16(frame->least_gain), gain = splat16(frame->largest_gain);
    gain = select16(gain * larger > 1.0f, most16(1.0f / larger, least), gain);
    Floats16 change = absolute16(encode16(gain * one) - encode16(gain * other));
    if (frame->spill[1] > 0.0f) {
        Floats16 excess = frame->spill[0] * larger - 1.0f;
        change += encode16(frame->spill[1] * least16(frame->spill[0] * difference, excess));
    }
    return select16(one == other, splat16(0.0f), least16(change, splat16(255.0f)));
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

static Floats16 colour_changes(const Frame *frame, const float one[3][BLOCK_RAYS],
                               const float other[3][BLOCK_RAYS]) {
    Floats16 change = splat16(0.0f);
    for (int channel = 0; channel < 3; channel++)
        change = most16(level_changes(frame, load16(one[channel]), load16(other[channel])), change);
    return change;
}

void find_level_changes(const Frame *frame, const float one[BLOCK_RAYS],
                        const float other[BLOCK_RAYS], float changes[BLOCK_RAYS]) {
    store16(level_changes(frame, load16(one), load16(other)), changes);
}

void find_colour_changes(const Frame *frame, const float one[3][BLOCK_RAYS],
                         const float other[3][BLOCK_RAYS], float changes[BLOCK_RAYS]) {
    store16(colour_changes(frame, one, other), changes);
}

/* Note that light above the well shows beside pixels so bright that change. */
static void note_spill(const FrameState *state, ChangeMeasure *measure, float brightest) {
    if (spilt_levels(state->frame, brightest, brightest) > VISIBLE_LEVELS)
        atomic_store_explicit(&measure->spills, 1, memory_order_relaxed);
}

/* Note the change of some pixels, whose brightest light is known. */
static void note_levels(const FrameState *state, ChangeMeasure *measure, int pixels, float change,
                        float brightest) {
    raise_largest(measure, change);
    if (change <= unseen_levels(state, measure))
        return;
    count_visible(measure, pixels);
    note_spill(state, measure, brightest);
}

static float brighter(Vec3 one, Vec3 other) {
    return fmaxf(fmaxf(fmaxf(one.x, other.x), fmaxf(one.y, other.y)), fmaxf(one.z, other.z));
}

void note_change(const FrameState *state, ChangeMeasure *measure, int pixels, Vec3 one,
                 Vec3 other) {
    Floats16 before = {one.x, one.y, one.z}, after = {other.x, other.y, other.z};
    note_levels(state, measure, pixels,
                most_of16(level_changes(state->frame, before, after)), brighter(one, other));
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

/* Note the changes of some of 16 pixels, whose brightest light is known. */
static void note_lanes(const FrameState *state, ChangeMeasure *measure, uint32_t lanes,
                       Floats16 change, Floats16 brightest) {
    Floats16 own = select16(mask16(lanes), change, splat16(0.0f));
    uint32_t visible = bits16(own > unseen_levels(state, measure));
    Floats16 bright = select16(mask16(visible), brightest, splat16(0.0f));
    raise_largest(measure, most_of16(own));
    if (!visible)
        return;
    count_visible(measure, __builtin_popcount(visible));
    note_spill(state, measure, most_of16(bright));
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
    uint32_t lanes = 0;
    for (int row = 0; row < pixels.rows; row++)
        lanes |= ((1u << pixels.columns) - 1) << row * TILE_PX;
    Floats16 change = splat16(0.0f), brightest = splat16(0.0f);
    for (int pair = 0; pair < pairs; pair++)
        for (int channel = 0; channel < 3; channel++) {
            Floats16 before = factor * load16(one[pair]->sum[channel]);
            Floats16 after = factor * load16(other[pair]->sum[channel]);
            change = most16(level_changes(frame, before, after), change);
            brightest = most16(most16(before, after), brightest);
        }
    note_lanes(state, measure, lanes, change, brightest);
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
    float bound = 0.0f;
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
    Floats16 brightest = splat16(0.0f);
    for (int channel = 0; channel < 3; channel++)
        brightest = most16(most16(load16(one[channel]), load16(other[channel])), brightest);
    note_lanes(state, measure, lanes,
               colour_changes(state->frame, (const float(*)[BLOCK_RAYS])one,
                              (const float(*)[BLOCK_RAYS])other),
               brightest);
}
