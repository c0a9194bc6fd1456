/* Beams: pyramids around the rays of square parts of the image, from one tile to 16 x 16 tiles.
 *
 * A beam is the cone {x : a_min <= a.x / axis.x <= a_max, b_min <= b.x / axis.x <= b_max} of the
 * viewpoint, or of an apex of its own where rays have origins (beam_origins.h). It holds every ray
 * of its part of the image; it knows no camera model, only the rays.
 */
#ifndef CATOPTRA_BEAMS_H
#define CATOPTRA_BEAMS_H

#include "ray_order.h"
#include "vectors.h"

enum { BEAM_LEVELS = 5 }; /* sides of 1, 2, 4, 8 and 16 tiles */

/* No ray; rays in more than a narrow cone, which bound nothing; rays within the pyramid. */
enum { BEAM_EMPTY, BEAM_WIDE, BEAM_NARROW };

typedef struct {
    int32_t kind;
    Vec3 axis, a, b; /* unit; a and b perpendicular to the axis */
    float a_min, a_max, b_min, b_max;
    Vec3 across, down; /* from left to right and from top to bottom of the part, for its parent */
} Beam;

/* Where the rays of a part begin, mirror frame. */
typedef struct {
    Vec3 apex;    /* of the part's pyramid */
    Vec3 centre;  /* of a sphere that holds the origins */
    float radius; /* metres */
} BeamOrigin;

typedef struct {
    int32_t rows, columns;
    Beam *beams;         /* (rows, columns) */
    BeamOrigin *origins; /* likewise, of narrow beams; NULL: all at the viewpoint */
} BeamLevel;

struct View {
    RayTable rays;
    int32_t tile_rows; /* of the image, as `rays.tile_columns` */
    int32_t *tile_at; /* (tile_rows, tile_columns) index in the table, -1 for tiles without rays */
    RayOrder by_row, by_cell; /* no rays where the view's have times of their own */
    float *pixel_scales; /* (t, 2, 3) columns and rows, px, of a change of the direction */
    float max_origin_m;  /* largest distance of a ray's origin from the viewpoint */
    BeamLevel levels[BEAM_LEVELS]; /* no beams where rays have times of their own */
};

/* Whether a narrow beam holds a unit direction, as those of its rays: widened by rounding. */
int is_direction_inside(const Beam *beam, Vec3 direction);

/* Unit directions of a narrow beam's edges; their number, 0 or 4. */
int list_beam_edges(const Beam *beam, Vec3 *edges);

#endif
