/* Provides fog_tile.h: tiles of one radiance in fog.
 * Float64 twin: world/objects.py:FogMedium. Owns nothing: pixels are the frame's.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "fog_tile.h"

#include "blur_plan.h"
#include "fog.h"
#include "measures.h"
#include "pixels.h"
#include "ranges.h"

int is_fogged_as_one(const FrameState *state, int tile) {
    TilePixels pixels = find_pixels(state, tile);
    return !state->is_rolling && pixels.rows == TILE_PX &&
           pixels.columns == TILE_PX;
}

/* A value changes most where least of its light passes. */
static float find_least(const float transmittance[TILE_PX * TILE_PX]) {
    float least = transmittance[0];
    for (int pixel = 1; pixel < TILE_PX * TILE_PX; pixel++)
        least = transmittance[pixel] < least ? transmittance[pixel] : least;
    return least;
}

static float mix(float radiance, float airlight, float transmittance) {
    return radiance * transmittance + airlight * (1.0f - transmittance);
}

void fill_fogged_tile(const FrameState *state, int tile, int32_t triangle, Vec3 radiance) {
    const float clear[3] = {radiance.x, radiance.y, radiance.z};
    const float *airlight = state->frame->airlight;
    _Alignas(64) float transmittance[TILE_PX * TILE_PX], fogged[3][TILE_PX * TILE_PX];
    find_plane_transmittances(state, tile, triangle, transmittance);
    float least = find_least(transmittance), most[3];
    for (int channel = 0; channel < 3; channel++) {
        for (int pixel = 0; pixel < TILE_PX * TILE_PX; pixel++)
            fogged[channel][pixel] = mix(clear[channel], airlight[channel], transmittance[pixel]);
        most[channel] = mix(clear[channel], airlight[channel], least);
    }
    if (state->frame->measures_fog)
        note_change(state, &state->measures->fog, TILE_PX * TILE_PX, radiance, vec3(most));
    write_radiance(state, tile, (const float(*)[TILE_PX * TILE_PX])fogged);
    fill_ranges(state, tile, triangle);
    if (!state->plan)
        return;
    note_plane(state, tile, triangle);
    note_means(state, tile, (const float(*)[TILE_PX * TILE_PX])fogged);
}
