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
    int is_table; /* the units are the table's own blocks, of 2 x 2 samples a pixel or of one; in
                   * others each lane follows by the pixel of the one before */
    uint16_t *source; /* (units, blocks, 16) number of the ray in the tile's part of the table */
} RayOrder;

/* Both return 0 if memory is short. */
int order_by_row(int samples, RayOrder *order);
int order_by_cell(int samples, RayOrder *order);

static inline const uint16_t *unit_source(const RayOrder *order, int unit, int block) {
    return order->source + (unit * order->blocks + block) * BLOCK_RAYS;
}

/* Add values of a block's lanes, one channel, to the sums of its unit's pixels. */
static inline void add_to_unit(const RayOrder *order, Floats16 lanes, float sums[BLOCK_RAYS]) {
    if (order->pixels == BLOCK_RAYS) {
        store16(load16(sums) + lanes, sums);
        return;
    }
    Floats16 v = order->is_table ? __builtin_shufflevector(lanes, lanes, 0, 2, 8, 10, 1, 3, 9, 11, 4,
                                                           6, 12, 14, 5, 7, 13, 15)
                                 : lanes;
    Floats4 sum = load4(sums) + __builtin_shufflevector(v, v, 0, 1, 2, 3);
    sum += __builtin_shufflevector(v, v, 4, 5, 6, 7);
    sum += __builtin_shufflevector(v, v, 8, 9, 10, 11);
    store4(sum + __builtin_shufflevector(v, v, 12, 13, 14, 15), sums);
}

#endif
