/* Beams of rays without a common viewpoint: an apex from which a pyramid holds all of a part's
 * rays.
 *
 * A ray lies within a convex cone if its origin and its direction do. So the apex is moved back
 * along the axis until the pyramid of the directions holds the origins, too: a proof about all
 * that the pyramid holds is one about the rays, provided that nothing it relies on lies nearer
 * than their origins. A parent holds its children's pyramids, as with one viewpoint.
 */
#ifndef CATOPTRA_BEAM_ORIGINS_H
#define CATOPTRA_BEAM_ORIGINS_H

#include "beams.h"

/* Rays begin at most this far from their place in the mirror frame: a camera far from the origin of
 * coordinates is made their origin, and float32 rounds the position of no other by more. */
#define ORIGIN_ROUNDING_M 2e-5f

/* Apex and origins of a narrow tile's beam, whose sides may be moved outward. */
void enclose_tile_origins(const RayTable *rays, int tile, Beam *beam, BeamOrigin *found);

/* The same of the parts of a larger one; the empty ones among them are NULL. */
void enclose_part_origins(const BeamOrigin *const parts[4], Beam *beam, BeamOrigin *found);

/* Whether a narrow tile's pyramid and sphere hold a ray's origin as they hold those of its rays. */
int is_origin_inside(const Beam *beam, const BeamOrigin *found, Vec3 origin);

#endif
