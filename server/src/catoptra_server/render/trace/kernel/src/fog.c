/* Provides fog.h: Koschmieder's law on samples.
 * Float64 twin: world/objects.py:FogMedium. Owns nothing: writes what its caller passes.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "fog.h"

#include "camera_rays.h"
#include "facet_plane.h"
#include "hit_points.h"
#include "pixels.h"

#include <string.h>

/* Less light passes than float32 can tell from none. */
#define MAX_DEPTH 87.0f

/* exp(-depth) of an optical depth, at most MAX_DEPTH: 2^i from the bits of a float, and Taylor's
 * series of the rest, at most ln(2) / 2: the first omitted term is 1e-7. No branch: vector code. */
static inline float decay(float distance, float density) {
    float depth = density * distance;
    /* Rounding can put a plane that holds the viewpoint behind it. */
    depth = depth > 0.0f ? depth : 0.0f;
    depth = depth < MAX_DEPTH ? depth : MAX_DEPTH;

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
    _Alignas(64) float distance[BLOCK_RAYS];
    uint32_t met = 0;
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        met |= (uint32_t)(hits->object[lane] != OBJECT_NONE) << lane;
    met &= rays->active;
    if (is_plane)
        memcpy(distance, rays->limit, sizeof distance);
    else
        find_hit_distances(state, rays, hits, met, distance);
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        transmittance[lane] = decay(distance[lane], density);
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

/* The same of rays with origins of their own, which are placed in the world. */
static void measure_transmittances(const FrameState *state, int tile, int32_t triangle,
                                   float means[TILE_PX * TILE_PX]) {
    int samples = state->rays->samples, blocks = samples * samples;
    FacetPlane plane = find_facet_plane(state, triangle);
    memset(means, 0, sizeof(float) * TILE_PX * TILE_PX);
    for (int block = 0; block < blocks; block++) {
        RayBlock rays;
        _Alignas(64) float distance[BLOCK_RAYS], transmittance[BLOCK_RAYS];
        load_block(state, (size_t)tile * (size_t)blocks + (size_t)block, &rays);
        find_distances(&plane, &rays, distance);
        for (int i = 0; i < BLOCK_RAYS; i++)
            transmittance[i] = decay(distance[i], state->frame->fog_density);
        add_lanes(samples, block, transmittance, means);
    }
    for (int pixel = 0; pixel < TILE_PX * TILE_PX; pixel++)
        means[pixel] *= 1.0f / (float)blocks;
}

void find_plane_transmittances(const FrameState *state, int tile, int32_t triangle,
                               float means[TILE_PX * TILE_PX]) {
    int samples = state->rays->samples, blocks = samples * samples;
    if (state->rays->origins) {
        measure_transmittances(state, tile, triangle, means);
        return;
    }
    FacetPlane plane = find_facet_plane(state, triangle);
    /* The plane is turned instead of the rays. */
    Vec3 n = rotate_back(state->camera.rotation, plane.normal);
    float height = dot(plane.normal, subtract(plane.first, vec3(state->camera.translation)));
    float density = state->frame->fog_density;
    const float *directions =
        state->rays->directions + (size_t)tile * (size_t)blocks * 3 * BLOCK_RAYS;
    memset(means, 0, sizeof(float) * TILE_PX * TILE_PX);
    for (int block = 0; block < blocks; block++, directions += 3 * BLOCK_RAYS) {
        _Alignas(64) float transmittance[BLOCK_RAYS];
        for (int i = 0; i < BLOCK_RAYS; i++) {
            float x = directions[i], y = directions[BLOCK_RAYS + i];
            float z = directions[2 * BLOCK_RAYS + i];
            transmittance[i] = decay(height / (n.x * x + n.y * y + n.z * z), density);
        }
        add_lanes(samples, block, transmittance, means);
    }
    for (int pixel = 0; pixel < TILE_PX * TILE_PX; pixel++)
        means[pixel] *= 1.0f / (float)blocks;
}
