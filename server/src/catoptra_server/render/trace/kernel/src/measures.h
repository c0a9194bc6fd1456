/* Largest changes that effects make in the finished picture, in encoded grey levels (0 to 255, not
 * rounded).
 *
 * Maxima over all pixels: independent of the order in which threads find them. Tiles whose
 * extremes show that they change by at most the largest change so far are skipped.
 */
#ifndef CATOPTRA_MEASURES_H
#define CATOPTRA_MEASURES_H

#include "pixels.h"

#include <stdatomic.h>

/* Of the shadows' threshold, that lamps may change without a ray: the rest decides. */
#define UNSEEN_PART 0.5f

struct Measures {
    _Atomic float shadow_change, fog_change;
    int blurs_unseen_shadows; /* the sharp frame shows none, other instants may */
    atomic_int skips_lamps;   /* some ray knows nothing of a lamp whose light nobody misses */
    atomic_int shows_watched; /* some ray meets the watched object first */
};

/* Change of the picture, grey levels, between two values of a channel, linear light. */
float level_change(const Frame *frame, float one, float other);

/* Change of a black pixel beside light that changes by a difference, above the well. */
float spilt_levels(const Frame *frame, float larger, float difference);

/* Note the change between two values of a channel. */
void note_level_change(const Frame *frame, _Atomic float *largest, float one, float other);

/* Note the change between two linear colours. */
void note_change(const Frame *frame, _Atomic float *largest, Vec3 one, Vec3 other);

/* Note the changes between the pixels of two sums of samples. */
void note_changes(const FrameState *state, int tile, _Atomic float *largest,
                  const PixelSums *one, const PixelSums *other);

#endif
