/* Light of directional and point lights on the hits of a block, and what of it is occluded. */
#ifndef CATOPTRA_DIRECT_LIGHT_H
#define CATOPTRA_DIRECT_LIGHT_H

#include "hit_points.h"
#include "light_map.h"

/* Distance of the origin of a ray from a facet, relative to the largest coordinate: positions and
 * corners are rounded to 2^-24 each, and a hit on a plane loses a few times that. 40 um at 10 m. */
#define SHADOW_BIAS 0x1p-18f

/* The hits of a block whose radiance is not in a table. */
typedef struct {
    HitPoints points;
    _Alignas(64) float albedo[3][BLOCK_RAYS];
    uint32_t computed; /* rays with a hit whose radiance is computed */
    uint32_t lit;      /* those that reflect light */
    uint32_t textured; /* those with a texture */
    uint32_t dim;      /* rays whose hits lack a part of the sky; computed or not */
    uint32_t objects;  /* rays that meet dynamic objects */
    uint32_t coloured; /* those of whose radiance no table has a part */
    uint32_t backs;    /* those that see the back of a facet of two sides */
    uint32_t emissive, smooth; /* those whose facets are */
    int num_proven;
    struct {
        uint32_t rays; /* computed ones that meet one facet */
        LightProof proof;
    } proven[MAX_PROVEN];
    /* Radiance, before textures, without lights that are added one by one; with has_allowed, how
     * much light of lamps nobody misses in it. */
    _Alignas(64) float unseen[3][BLOCK_RAYS];
    int has_allowed;
} SurfaceBlock;

/* Radiance that rays lose by shadows. */
typedef struct {
    _Alignas(64) float radiance[3][BLOCK_RAYS]; /* entries of other rays mean nothing */
    uint32_t rays;                              /* bit mask of those that lose any */
} LostLight;

/* Whether nothing occludes any directional light where rays meet the static scene, by height maps;
 * the rays' limits are the distances of their hits. */
int sees_all_lights(const FrameState *state, const RayBlock *rays, const HitBlock *hits);

/* Lamps, of the first 32 and other than those of a mask, whose light on the part of a static facet
 * between four points is so faint that hardly any ray to them is cast. */
uint32_t find_faint_lamps(const FrameState *state, int32_t triangle, const Vec3 corners[4],
                          uint32_t others);

/* Add the light of one directional or point light to the lit rays, and what is occluded to `lost`,
 * which may be NULL. No ray is cast to lamps that `unseen` allows. */
void add_light(const FrameState *state, int light, const RayBlock *rays, const HitBlock *hits,
               SurfaceBlock *surface, float radiance[3][BLOCK_RAYS], LostLight *lost);

#endif
