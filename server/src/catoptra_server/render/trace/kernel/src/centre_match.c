/* Provides catoptra_match_centres: which tiles of a view have the pixels' centres of another table
 * of the same image, and whether the view's beams hold these rays, too, so that its proofs are
 * proofs about them.
 * No twin. The caller has the results; the index is freed at the end.
 * Threads: the calling thread alone. */
#include "beam_origins.h"
#include "vectors.h"

#include <stdlib.h>
#include <string.h>

static int is_ray_inside(const BeamLevel *tiles, int number, Vec3 origin, Vec3 direction) {
    const Beam *beam = tiles->beams + number;
    return beam->kind == BEAM_NARROW && is_direction_inside(beam, direction) &&
           (!tiles->origins || is_origin_inside(beam, tiles->origins + number, origin));
}

/* Whether the beam of a tile holds the rays of its pixels' centres, too. */
static int holds_centres(const View *view, int tile, const RayTable *centres, int32_t at) {
    const BeamLevel *tiles = view->levels;
    const float(*directions)[BLOCK_RAYS] =
        (const float(*)[BLOCK_RAYS])(centres->directions + (size_t)at * 3 * BLOCK_RAYS);
    const float(*origins)[BLOCK_RAYS] = NULL;
    if (centres->origins)
        origins = (const float(*)[BLOCK_RAYS])(centres->origins + (size_t)at * 3 * BLOCK_RAYS);
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        Vec3 origin = origins ? get_lane(origins, lane) : (Vec3){0, 0, 0};
        if (centres->valid[at] >> lane & 1 &&
            !is_ray_inside(tiles, view->rays.tiles[tile], origin, get_lane(directions, lane)))
            return 0;
    }
    return 1;
}

int32_t catoptra_match_centres(const View *view, const RayTable *centres, int32_t *centre_tile,
                               uint8_t *is_held) {
    size_t numbers = (size_t)view->tile_rows * (size_t)view->rays.tile_columns;
    const Beam *beams = view->levels[0].beams;
    int32_t *at = malloc(sizeof *at * numbers), unmatched = 0;
    if (!at)
        return -1;
    memset(at, 0xff, sizeof *at * numbers);
    for (int32_t i = 0; i < centres->num_tiles; i++) {
        int32_t number = centres->tiles[i];
        at[number] = i;
        unmatched += centres->valid[i] && (view->tile_at[number] < 0 ||
                                           (beams && beams[number].kind == BEAM_EMPTY));
    }
    for (int32_t tile = 0; tile < view->rays.num_tiles; tile++) {
        centre_tile[tile] = at[view->rays.tiles[tile]];
        is_held[tile] = beams && centre_tile[tile] >= 0 &&
                        holds_centres(view, tile, centres, centre_tile[tile]);
    }
    free(at);
    return unmatched;
}
