/* Other orders of a tile's rays: in units of a few pixels, whose rays share an instant of the
 * exposure.
 *
 * With a rolling shutter a unit is one row of four pixels; for motion blur a square of 2 x 2
 * pixels, of which many are left sharp, or with one sample a pixel the whole tile, which is one
 * block.
 */
#ifndef CATOPTRA_RAY_ORDER_H
#define CATOPTRA_RAY_ORDER_H

#include "ray_block.h"

enum { NO_RAY = 0xffff, MAX_UNITS = 4 };

typedef struct {
    int units, pixels; /* units of a tile, pixels of a unit */
    int blocks;        /* of a unit */
    uint8_t pixel[MAX_UNITS][TILE_PX * TILE_PX]; /* of the tile, of each pixel of a unit */
    uint8_t lane_pixel[BLOCK_RAYS];              /* pixel of the unit of each lane of a block */
    int is_table;           /* the units are the table's own blocks */
    uint16_t *source; /* (units, blocks, 16) number of the ray in the tile's part of the table */
} RayOrder;

/* Both return 0 if memory is short. */
int order_by_row(int samples, RayOrder *order);
int order_by_cell(int samples, RayOrder *order);

static inline const uint16_t *unit_source(const RayOrder *order, int unit, int block) {
    return order->source + (unit * order->blocks + block) * BLOCK_RAYS;
}

#endif
