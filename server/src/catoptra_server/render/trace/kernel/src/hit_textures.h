/* Texture colours of a block's hits, each on a facet of its own. */
#ifndef CATOPTRA_HIT_TEXTURES_H
#define CATOPTRA_HIT_TEXTURES_H

#include "direct_light.h"
#include "texture_levels.h"

/* Texels around a block's points, by component. */
typedef struct {
    const uint8_t *upper[BLOCK_RAYS];
    _Alignas(64) int32_t stride[BLOCK_RAYS], size[BLOCK_RAYS];
    float fx[BLOCK_RAYS], fy[BLOCK_RAYS];
    uint32_t bytes;     /* rays whose texels are bytes, of this light */
    const float *light;
} TexelSquares;

/* What a block reads of textures: of `mixed` rays two levels. */
typedef struct PlacedTexels {
    uint32_t lanes, mixed;
    TexelSquares fine, coarse;
    float weight[BLOCK_RAYS];
} PlacedTexels;

/* One texture of all rays, or NULL and one of each; whether any has a sampling of its own. */
typedef struct {
    const Texture *common, *own[BLOCK_RAYS];
    int is_special;
} TextureChoice;

/* Find the texels of some rays by points whose footprints are measured, and request them from
 * memory: all before the first is used. */
void place_textures(const TextureChoice *from, const TexturePoints *points, uint32_t lanes,
                    PlacedTexels *placed);

/* Colours, (3, 16), of these rays; white for the others. */
void mix_textures(const PlacedTexels *placed, float colours[3][BLOCK_RAYS]);

/* Find the texels of the textured rays, likewise. */
void place_hit_textures(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                        const SurfaceBlock *surface, PlacedTexels *placed);

#endif
