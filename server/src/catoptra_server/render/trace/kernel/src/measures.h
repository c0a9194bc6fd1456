/* Changes that effects make in the finished picture, in encoded grey levels (0 to 255, not
 * rounded). Tiles whose extremes show that they change neither visibly nor by more than the largest
 * change so far are skipped.
 */
#ifndef CATOPTRA_MEASURES_H
#define CATOPTRA_MEASURES_H

#include "pixel_change.h"
#include "pixels.h"

/* Of the plain change, that lamps may change without a ray: the rest decides. */
#define UNSEEN_PART 0.5f

struct Measures {
    ChangeMeasure shadow, fog, gloss, light, blur;
    ChangeMeasure gathered;   /* by motion where the sharp frame's samples tell */
    ChangeMeasure bright;     /* by baked light where it is beyond white */
    ChangeMeasure spilt;      /* over black pixels, by baked light above the well */
    ChangeMeasure watched;    /* against frames without the watched object */
    int blurs_unseen_shadows; /* the sharp frame shows none, other instants may */
    /* Bit mask of MEASURE_... that a part of the frame has decided: the rest measures no more. Set
     * between passes. */
    int ended;
    atomic_int skips_lamps;   /* some ray knows nothing of a lamp whose light nobody misses */
    atomic_int shows_watched; /* some ray meets the watched object first */
    atomic_int drops_layers;  /* some ray meets more blended facets than are shown */
};

/* Whether it is wanted what shadows take of each pixel's light, and the number of an object without
 * which the frame is wanted too; 0: none. */
static inline int finds_shadow_change(const FrameState *state) {
    const Frame *frame = state->frame;
    return frame->has_shadows && frame->measures_shadows &&
           !(state->measures->ended & MEASURE_SHADOWS);
}

static inline int32_t find_watched(const FrameState *state) {
    return state->measures->ended & MEASURE_WATCHED ? 0 : state->frame->watched_object;
}

/* End the measures whose effects are on whatever else is found. */
void end_measures(const FrameState *state);

/* Changes of the picture, grey levels, between 16 values of a channel, linear light, and 16 others;
 * and between colours. */
void find_level_changes(const Frame *frame, const float one[BLOCK_RAYS],
                        const float other[BLOCK_RAYS], float changes[BLOCK_RAYS]);
void find_colour_changes(const Frame *frame, const float one[3][BLOCK_RAYS],
                         const float other[3][BLOCK_RAYS], float changes[BLOCK_RAYS]);

/* Change of a black pixel beside light that changes by a difference, above the well. */
float spilt_levels(const Frame *frame, float larger, float difference);

/* Change up to which a pixel does not count as visible: lamps without a ray add to the shadows'. */
float unseen_levels(const FrameState *state, const ChangeMeasure *measure);

/* Change by baked light. In a mean up to white, samples beyond white weigh less than their light's
 * inverse, all others 1 together: the changes of both are added as powers of the curve, 2.4, whose
 * root is below that of their squares. */
PixelChange find_light_change(const FrameState *state, int pixels);

/* Note the change of some pixels between two linear colours. */
void note_change(const FrameState *state, ChangeMeasure *measure, int pixels, Vec3 one, Vec3 other);

/* Note the changes between the pixels of two sums of samples; and of some pairs of sums, of which
 * each pixel's largest change counts. */
void note_changes(const FrameState *state, int tile, ChangeMeasure *measure, const PixelSums *one,
                  const PixelSums *other);
void note_largest_changes(const FrameState *state, int tile, ChangeMeasure *measure, int pairs,
                          const PixelSums *const *one, const PixelSums *const *other);

/* Note the changes of some samples between two radiances, (3, 16): no mean of samples changes by
 * more levels than one of them, by Minkowski's inequality, the sRGB curve being a root. */
void note_samples(const FrameState *state, ChangeMeasure *measure, uint32_t lanes,
                  float one[3][BLOCK_RAYS], float other[3][BLOCK_RAYS]);

#endif
