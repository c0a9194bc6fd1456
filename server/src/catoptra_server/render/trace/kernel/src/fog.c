#include "fog.h"

#include "hit_points.h"

#include <string.h>

/* Less light passes than float32 can tell from none. */
#define MAX_DEPTH 87.0f

/* exp(-depth), depth from 0 to MAX_DEPTH: 2^i from the bits of a float, and Taylor's series of the
 * rest, at most ln(2) / 2; its first omitted term is 1e-7. Without a branch: vector code. */
static inline float decay(float depth) {
    float power = depth * -1.44269504f;
    int32_t whole = (int32_t)(power - 0.5f);
    /* In two parts: the first has so few digits that its product is exact. */
    float rest = (-depth - (float)whole * 0.693359375f) + (float)whole * 2.12194440e-4f;
    float series = 1.0f + rest * (1.0f + rest * (0.5f + rest * (1.0f / 6 + rest * (1.0f / 24 +
                          rest * (1.0f / 120 + rest * (1.0f / 720))))));
    int32_t bits = (whole + 127) * (1 << 23);
    float scale_factor;
    memcpy(&scale_factor, &bits, sizeof bits);
    return series * scale_factor;
}

/* Fractions of light that pass from the hits to the viewpoint; none from the background. */
static void find_transmittances(const FrameState *state, const RayBlock *rays,
                                const HitBlock *hits, int is_plane,
                                float transmittance[BLOCK_RAYS]) {
    float density = state->frame->fog_density;
    HitPoints points;
    uint32_t met = 0;
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        met |= (uint32_t)(hits->object[lane] != OBJECT_NONE) << lane;
    met &= rays->active;
    if (is_plane)
        memcpy(points.distance, rays->limit, sizeof points.distance);
    else
        find_hit_points(state, rays, hits, met, &points);
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        float depth = density * points.distance[lane];
        /* Rounding can put a plane that holds the viewpoint behind it. */
        depth = depth > 0.0f ? depth : 0.0f;
        transmittance[lane] = decay(depth < MAX_DEPTH ? depth : MAX_DEPTH);
    }
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        transmittance[lane] = met >> lane & 1 ? transmittance[lane] : 0.0f;
}

void fog_block(const FrameState *state, const RayBlock *rays, const HitBlock *hits, int is_plane,
               float radiance[3][BLOCK_RAYS], LostLight *lost) {
    _Alignas(64) float transmittance[BLOCK_RAYS];
    find_transmittances(state, rays, hits, is_plane, transmittance);
    for (int channel = 0; channel < 3; channel++) {
        float airlight = state->frame->airlight[channel];
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            radiance[channel][lane] = radiance[channel][lane] * transmittance[lane] +
                                      airlight * (1.0f - transmittance[lane]);
        for (int lane = 0; lost && lost->rays && lane < BLOCK_RAYS; lane++)
            lost->radiance[channel][lane] *= transmittance[lane];
    }
}
