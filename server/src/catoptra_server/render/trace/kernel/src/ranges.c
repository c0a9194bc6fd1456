/* Provides ranges.h: mean inverse ranges of pixels.
 * Float64 twin: reference/reference_engine.py. Owns nothing: ranges are Python's.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "ranges.h"

#include "camera_rays.h"
#include "facet_plane.h"
#include "hit_points.h"
#include "tile_place.h"

#include <string.h>

/* Rounding can put a plane that holds the viewpoint behind it: a tenth of a millimetre. */
#define MAX_INVERSE_RANGE 1e4f

static float limit_inverse(float inverse) {
    /* Also of what is not a number. */
    return inverse >= 0.0f && inverse < MAX_INVERSE_RANGE ? inverse : MAX_INVERSE_RANGE;
}

/* One plane that all rays meet: from one origin the inverse of its distance is linear. */
static void invert_plane(const FrameState *state, int32_t triangle, const RayBlock *rays,
                         float inverse[BLOCK_RAYS]) {
    FacetPlane plane = find_facet_plane(state, triangle);
    if (rays->has_origins) {
        find_distances(&plane, rays, inverse);
        for (int i = 0; i < BLOCK_RAYS; i++)
            inverse[i] = limit_inverse(1.0f / inverse[i]);
        return;
    }
    Vec3 origin = {rays->origin[0][0], rays->origin[1][0], rays->origin[2][0]};
    Vec3 n = scale(1.0f / dot(plane.normal, subtract(plane.first, origin)), plane.normal);
    for (int i = 0; i < BLOCK_RAYS; i++)
        inverse[i] = limit_inverse(n.x * rays->direction[0][i] + n.y * rays->direction[1][i] +
                                   n.z * rays->direction[2][i]);
}

void find_inverse_ranges(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                         float inverse[BLOCK_RAYS]) {
    _Alignas(64) float distance[BLOCK_RAYS];
    uint32_t met = 0;
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        met |= (uint32_t)(hits->object[lane] != OBJECT_NONE) << lane;
    met &= rays->active;
    find_hit_distances(state, rays, hits, met, distance);
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        inverse[lane] = met >> lane & 1 ? limit_inverse(1.0f / distance[lane]) : 0.0f;
}

void fill_ranges(const FrameState *state, int tile, int32_t triangle) {
    int blocks = state->rays->samples * state->rays->samples;
    float sums[TILE_PX * TILE_PX];
    memset(sums, 0, sizeof sums);
    for (int block = 0; triangle >= 0 && block < blocks; block++) {
        RayBlock rays;
        float inverse[BLOCK_RAYS];
        load_block(state, (size_t)tile * (size_t)blocks + (size_t)block, &rays);
        invert_plane(state, triangle, &rays, inverse);
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            sums[pixel_of_lane(state, block, lane)] += inverse[lane];
    }
    write_ranges(state, tile, sums);
}

void write_ranges(const FrameState *state, int tile, const float sums[TILE_PX * TILE_PX]) {
    TilePlace place = place_tile(state->rays, state->rays->tiles[tile]);
    float factor = 1.0f / (float)(state->rays->samples * state->rays->samples);
    for (int row = 0; row < place.rows; row++)
        for (int column = 0; column < place.columns; column++)
            state->frame->inverse_range[place.first + (size_t)row * place.width_px +
                                        (size_t)column] = factor * sums[row * TILE_PX + column];
}
