/* Proof that one flat surface of the static scene fills a part of the image.
 *
 * A beam (beams.h) holds all rays of the part. The part shows one surface, whatever its samples, if
 * (1) the ray along the beam's axis meets the surface first, (2) no outer edge of the surface
 * passes through the beam, and (3) everything else that reaches into the beam lies behind the
 * surface's plane. (1) and (2): the surface covers the beam's whole section. Rays with origins of
 * their own must begin before that plane; then the same holds of their beams. The tests are
 * conservative: a triangle counts as outside only if a plane separates all of it from the beam.
 * Parts that are not proven are split in four; what lies outside a part, or behind a surface that
 * covers it, is not tested again in its quarters (Warnock 1969).
 */
#ifndef CATOPTRA_COVERAGE_H
#define CATOPTRA_COVERAGE_H

#include "candidates.h"

/* Whether a proof can save anything in a frame: surfaces, beams, and no triangle numbers, which
 * rays alone find. */
int can_prove_coverage(const FrameState *state);

/* Space for the searches of one thread, in frames of so many candidates by objects' boxes. */
typedef struct Search Search;
Search *create_search(const FrameState *state, int num_boxes);
void release_search(Search *search);

/* Search on with another state and its objects, at most as many as the search was created for.
 * With a count of rays, the parts are those that a moving frame's plan wants, and they are blurred. */
void aim_search(Search *search, const FrameState *state, const CandidateList *objects,
                int64_t *blur_rays);

/* Render the tiles of a part of the coarsest level; returns how many are filled. */
int render_part(Search *search, const View *view, int part);

#endif
