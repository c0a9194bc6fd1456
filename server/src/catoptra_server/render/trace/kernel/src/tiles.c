/* Provides tiles.h: the ways to render a tile, from the one that needs no ray to the one that
 * traces every sample.
 * Float64 twin: reference/reference_engine.py. Owns nothing: blocks are on the stack, outputs are
 * Python's.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "tiles.h"

#include "blur_plan.h"
#include "camera_rays.h"
#include "facet_plane.h"
#include "flow.h"
#include "fog.h"
#include "fog_tile.h"
#include "gloss.h"
#include "hit_textures.h"
#include "hit_points.h"
#include "instances.h"
#include "labels.h"
#include "measures.h"
#include "occlusion.h"
#include "plane_light.h"
#include "ranges.h"
#include "shading.h"
#include "sky.h"

#include <math.h>
#include <string.h>

/* Blended facets that a ray shows, the nearest; behind them, what is opaque. Twin:
 * world/shading.py:MAX_LAYERS. */
enum { MAX_LAYERS = 8, NO_PLAN = -1 };
/* Coverage from which a blended facet is a layer: a fainter one changes black by less than half a
 * grey level. */
#define LEAST_LAYER 0x1p-12f

static void clear_hits(HitBlock *hits) {
    memset(hits->triangle, 0xff, sizeof hits->triangle);
    memset(hits->object, 0xff, sizeof hits->object);
}

static FacetPlane plane_of(const FrameState *state, const TileContent *content) {
    return content->plane ? *content->plane : find_facet_plane(state, content->triangle);
}

/* The hits of rays that all meet one facet's plane; their distances limit the rays. */
static void set_hits(const FrameState *state, RayBlock *rays, HitBlock *hits,
                     const TileContent *content) {
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        hits->triangle[lane] = content->triangle;
        hits->object[lane] = OBJECT_STATIC;
    }
    FacetPlane plane = plane_of(state, content);
    find_distances(&plane, rays, rays->limit);
}

static void intersect_scene(const FrameState *state, const ShortList *short_list, RayBlock *rays,
                            HitBlock *hits) {
    if (short_list && intersect_short_list(short_list, rays, hits))
        return;
    intersect_bvh(&state->scene->mesh->bvh, place_of(state), OBJECT_STATIC, rays, hits);
}

/* Bit mask of the rays that meet the watched object first; that it is seen is noted. */
static uint32_t watch_object(const FrameState *state, const RayBlock *rays, const HitBlock *hits) {
    int32_t watched = find_watched(state);
    uint32_t lanes = 0;
    for (int lane = 0; watched && lane < BLOCK_RAYS; lane++)
        lanes |= (uint32_t)(hits->object[lane] == watched) << lane;
    lanes &= rays->active;
    if (lanes)
        atomic_store_explicit(&state->measures->shows_watched, 1, memory_order_relaxed);
    return lanes;
}

/* The scene's hits limit the rays: only nearer objects, any or one or none, overwrite them. */
static void intersect_objects(const FrameState *state, int32_t object, RayBlock *rays,
                              HitBlock *hits) {
    if (object == OBJECT_NONE)
        return;
    if (state->objects && object == OBJECT_ANY)
        intersect_instances(state, rays, hits);
    else if (object != OBJECT_ANY)
        intersect_object(state, object, rays, hits);
}

void intersect_content(const FrameState *state, RayBlock *rays, HitBlock *hits,
                       const TileContent *content) {
    clear_hits(hits);
    if (content->triangle == SURFACE_UNKNOWN)
        intersect_scene(state, content->short_list, rays, hits);
    else if (content->triangle >= 0)
        set_hits(state, rays, hits, content);
    intersect_objects(state, content->object, rays, hits);
}

/* The first hits of rays beyond (16,) distances, or NULL for 0, on opaque surfaces and on blended
 * facets of a coverage. */
static void find_layer(const FrameState *state, const float *begin, float least_coverage,
                       int32_t object, RayBlock *rays, HitBlock *hits) {
    clear_hits(hits);
    store16(splat16(INFINITY), rays->limit);
    intersect_layer(&state->scene->mesh->bvh, place_of(state), begin, least_coverage, rays, hits);
    intersect_objects(state, object, rays, hits);
}

/* Whether rays of a tile may meet blended facets, which no proof and no short list holds. */
static int may_blend(const FrameState *state, const TileContent *content) {
    return state->scene->mesh->arrays.blended && content->triangle == SURFACE_UNKNOWN &&
           !content->short_list;
}

uint32_t find_hits(const FrameState *state, RayBlock *rays, HitBlock *hits,
                   const TileContent *content) {
    intersect_content(state, rays, hits, content);
    if (content->object == OBJECT_NONE)
        return 0;
    if (!find_watched(state) || !may_blend(state, content))
        return watch_object(state, rays, hits);
    /* It is seen through all that blends. */
    RayBlock through = *rays;
    HitBlock opaque;
    find_layer(state, NULL, INFINITY, content->object, &through, &opaque);
    return watch_object(state, &through, &opaque);
}

void trace_tile(const FrameState *state, int tile) {
    int blocks = state->rays->samples * state->rays->samples;
    for (int block = 0; block < blocks; block++) {
        RayBlock rays;
        HitBlock hits;
        load_block(state, (size_t)tile * (size_t)blocks + (size_t)block, &rays);
        find_hits(state, &rays, &hits, &UNKNOWN_CONTENT);
    }
}

static void store_hits(const FrameState *state, size_t block, const RayBlock *rays,
                       const HitBlock *hits) {
    const Frame *frame = state->frame;
    HitPoints points;
    uint32_t met = 0;
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        met |= (uint32_t)(hits->object[lane] != OBJECT_NONE) << lane;
    met &= rays->active;
    find_hit_points(state, rays, hits, met, &points);
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        size_t at = block * BLOCK_RAYS + (size_t)lane;
        int is_met = met >> lane & 1;
        /* Rounding can put a plane that holds the viewpoint behind it. */
        frame->range_m[at] = is_met ? fmaxf(points.distance[lane], 0.0f) : INFINITY;
        frame->triangle[at] = is_met ? hits->triangle[lane] : -1;
        frame->object[at] = is_met ? hits->object[lane] : OBJECT_NONE;
    }
}

/* Pixels of one sample each, whose radiance is all in tables. */
static void write_table_colours(const FrameState *state, int tile, uint32_t active,
                                const HitBlock *hits) {
    const uint32_t *encoded = state->scene->encoded;
    TilePixels pixels = find_pixels(state, tile);
    for (int row = 0; row < pixels.rows; row++)
        for (int column = 0; column < pixels.columns; column++) {
            int lane = row * TILE_PX + column, object = hits->object[lane];
            char *pixel = pixel_at(&pixels, row, column);
            /* Pixels beside the mirror stay black. */
            if (!(active >> lane & 1))
                continue;
            if (object == OBJECT_STATIC)
                write_encoded(pixel, encoded[hits->triangle[lane]]);
            else if (object == OBJECT_NONE)
                write_encoded(pixel, encoded[state->scene->mesh->arrays.num_triangles]);
            else
                write_mean(state, pixel, table_entry(state, object, hits->triangle[lane]));
        }
}

static int has_table_colours(const FrameState *state, const RayBlock *rays, const HitBlock *hits) {
    const uint8_t *facets = state->scene->mesh->arrays.flags;
    if (state->has_point_lights || state->frame->output != OUTPUT_SRGB || state->plan ||
        state->frame->inverse_range || state->frame->shades || has_fog(state) || state->scene->mesh->arrays.blended)
        return 0;
    int meets_object = 0, is_special = 0;
    uint8_t flags = 0;
    if (state->scene->sky && bits16(load_ints16(hits->object) == OBJECT_NONE) & rays->active)
        return 0;
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        int object = hits->object[lane];
        meets_object |= object > OBJECT_STATIC;
        if (rays->active >> lane & 1 && object > OBJECT_STATIC)
            flags |= mesh_of(state, object)->flags[hits->triangle[lane]];
        if (!(rays->active >> lane & 1 && object == OBJECT_STATIC))
            continue;
        flags |= facets[hits->triangle[lane]];
        is_special |= is_glossy(state, hits->triangle[lane]) ||
                      has_occlusion(state->scene, hits->triangle[lane]);
    }
    return !(flags & (FACET_TEXTURED | FACET_COMPUTED | FACET_TWO_SIDED)) &&
           !is_special &&
           (!meets_object || state->object_radiance) &&
           (state->is_constant || sees_all_lights(state, rays, hits));
}

int is_wholly_valid(const FrameState *state, int tile) {
    int blocks = state->rays->samples * state->rays->samples;
    for (int block = 0; block < blocks; block++)
        if (state->rays->valid[(size_t)tile * (size_t)blocks + (size_t)block] != 0xffff)
            return 0;
    return 1;
}

/* One colour of all pixels of a tile into the plan of a moving frame. */
static void note_colour(const FrameState *state, int tile, Vec3 colour) {
    float channels[3] = {colour.x, colour.y, colour.z}, means[3][TILE_PX * TILE_PX];
    for (int channel = 0; channel < 3; channel++)
        for (int pixel = 0; pixel < TILE_PX * TILE_PX; pixel++)
            means[channel][pixel] = channels[channel];
    note_means(state, tile, (const float(*)[TILE_PX * TILE_PX])means);
}

/* A tile of one radiance: no ray, no sum. */
static void fill_tile(const FrameState *state, int tile, const TileContent *content, size_t entry,
                      const PlaneLight *light) {
    const Scene *scene = state->scene;
    TilePixels pixels = find_pixels(state, tile);
    char row_of_pixels[TILE_PX * 3 * sizeof(float)];
    for (int column = 0; column < TILE_PX; column++) {
        char *pixel = row_of_pixels + (size_t)column * pixels.pixel_bytes;
        if (!light->is_table)
            write_mean(state, pixel, light->radiance);
        else if (state->frame->output == OUTPUT_LINEAR)
            write_mean(state, pixel, vec3(scene->sharp_radiance + 3 * entry));
        else
            write_encoded(pixel, scene->encoded[entry]);
    }
    for (int row = 0; row < pixels.rows; row++)
        memcpy(pixel_at(&pixels, row, 0), row_of_pixels,
               (size_t)pixels.columns * pixels.pixel_bytes);
    if (finds_shadow_change(state) && !light->is_table)
        note_change(state, &state->measures->shadow, pixels.rows * pixels.columns, light->radiance,
                    add(light->radiance, light->lost));
    if (state->frame->measures_fog && has_fog(state))
        note_change(state, &state->measures->fog, pixels.rows * pixels.columns, light->radiance,
                    vec3(scene->sharp_radiance + 3 * entry));
    fill_ranges(state, tile, content->triangle);
    if (!state->plan)
        return;
    note_plane(state, tile, content->triangle);
    note_colour(state, tile,
                light->is_table ? vec3(scene->sharp_radiance + 3 * entry) : light->radiance);
}

/* Radiance of a tile if it is the same all over it in clear air; 0 otherwise. */
static int find_single_radiance(const FrameState *state, const TileContent *content,
                                PlaneLight *light, size_t *entry) {
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    if (content->triangle == SURFACE_BACKGROUND) {
        /* In fog the sky is the airlight, whose change is that of each direction. */
        if (state->scene->sky && (!has_fog(state) || state->frame->measures_fog))
            return 0;
        *entry = (size_t)mesh->num_triangles;
        *light = (PlaneLight){.is_table = !has_fog(state),
                              .radiance = vec3(state->frame->airlight)};
        return 1;
    }
    *entry = (size_t)content->triangle;
    return !(mesh->flags[content->triangle] & FACET_TEXTURED) &&
           !is_glossy(state, content->triangle) &&
           (content->is_open || !has_occlusion(state->scene, content->triangle)) &&
           find_plane_light(state, content->triangle, content->proof, light);
}

/* One radiance times the facet's texture, if it has one. */
static void fill_block(const FrameState *state, const TileContent *content, const RayBlock *rays,
                       Vec3 light, float radiance[3][BLOCK_RAYS]) {
    int32_t triangle = content->triangle;
    if (state->scene->mesh->arrays.flags[triangle] & FACET_TEXTURED) {
        FacetPlane plane = plane_of(state, content);
        texture_block(state, triangle, &plane, rays, light, radiance);
        return;
    }
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        set_lane(radiance, lane, light);
}

static void shade(const FrameState *state, const RayBlock *rays, const HitBlock *hits,
                  const TileContent *content, float radiance[3][BLOCK_RAYS], LostLight *lost) {
    int is_known = content->triangle >= 0 && content->object == OBJECT_NONE &&
                   !(content->is_shaded && !content->factors);
    PlaneLight light;
    if (!is_known || rays->active != 0xffff ||
        !find_plane_light(state, content->triangle, content->proof, &light)) {
        shade_block(state, rays, hits, is_known ? &content->proof : NULL, content->proofs,
                    is_known && content->is_open, radiance, lost);
        return;
    }
    fill_block(state, content, rays, light.radiance, radiance);
    if (!content->is_open && has_occlusion(state->scene, content->triangle))
        hide_sky_in_block(state, content->triangle, rays, light.radiance, content->factors,
                          radiance);
    if (lost && max_abs(light.lost) > 0.0f) {
        fill_block(state, content, rays, light.lost, lost->radiance);
        lost->rays = 0xffff;
    }
}

static int measures_fog(const FrameState *state) {
    return state->frame->measures_fog && has_fog(state);
}

/* Shade, mirror and fog a block's hits; their radiance in clear air, where that is wanted. */
static void shade_hits(const FrameState *state, int tile, const RayBlock *rays,
                       const HitBlock *hits, const TileContent *content,
                       float radiance[3][BLOCK_RAYS], LostLight *lost,
                       float clear[3][BLOCK_RAYS]) {
    shade(state, rays, hits, content, radiance, lost);
    /* Changes are those of the sharp frame, whose tiles have a number. */
    add_gloss(state, rays, hits, tile != NO_PLAN, content->mirrored, radiance, lost);
    if (!has_fog(state))
        return;
    if (clear)
        memcpy(clear, radiance, 3 * sizeof *radiance);
    int is_plane = content->triangle >= 0 && content->object == OBJECT_NONE;
    fog_block(state, rays, hits, is_plane, radiance, lost);
}

/* Bit mask of the rays whose hits are blended facets. */
static uint32_t find_blended(const FrameState *state, const RayBlock *rays, const HitBlock *hits) {
    const uint8_t *blended = state->scene->mesh->arrays.blended;
    uint32_t lanes = 0;
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        if (rays->active >> lane & 1 && hits->object[lane] == OBJECT_STATIC)
            lanes |= (uint32_t)blended[hits->triangle[lane]] << lane;
    return lanes;
}

/* Sums, of the first layer anew, of parts of the light of some rays. */
static void add_parts(uint32_t lanes, int layer, const float parts[BLOCK_RAYS],
                      float light[3][BLOCK_RAYS], float sums[3][BLOCK_RAYS]) {
    for (int channel = 0; channel < 3; channel++)
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            if (lanes >> lane & 1)
                sums[channel][lane] = (layer > 1 ? sums[channel][lane] : 0.0f) +
                                      parts[lane] * light[channel][lane];
}

/* Note whether rays that show all their layers meet a further one; once in a frame. */
static void note_dropped_layer(const FrameState *state, const float begin[BLOCK_RAYS],
                               int32_t object, RayBlock *rays, HitBlock *hits) {
    if (atomic_load_explicit(&state->measures->drops_layers, memory_order_relaxed))
        return;
    find_layer(state, begin, LEAST_LAYER, object, rays, hits);
    if (find_blended(state, rays, hits))
        atomic_store_explicit(&state->measures->drops_layers, 1, memory_order_relaxed);
}

/* Blend what the active rays meet, the first hits being blended facets, front to back. Each layer
 * is fogged up to its own distance, which is exact: what lies behind is fogged as if nothing were
 * before it, and shows by what the layers before let through. */
static void shade_layers(const FrameState *state, int tile, int32_t object, RayBlock *rays,
                         HitBlock *hits, float radiance[3][BLOCK_RAYS], LostLight *lost,
                         float clear[3][BLOCK_RAYS]) {
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    TileContent content = UNKNOWN_CONTENT;
    float begin[BLOCK_RAYS], passing[BLOCK_RAYS], part[BLOCK_RAYS];
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        passing[lane] = 1.0f;
    for (int layer = 1; rays->active; layer++) {
        _Alignas(64) float light[3][BLOCK_RAYS], clear_light[3][BLOCK_RAYS];
        LostLight layer_lost = {.rays = 0};
        if (layer > MAX_LAYERS)
            note_dropped_layer(state, begin, object, rays, hits);
        if (layer > 1)
            find_layer(state, begin, layer <= MAX_LAYERS ? LEAST_LAYER : INFINITY, object, rays,
                       hits);
        if (state->plan && tile != NO_PLAN)
            note_hits(state, tile, rays, hits);
        shade_hits(state, tile, rays, hits, &content, light, lost ? &layer_lost : NULL,
                   clear ? clear_light : NULL);
        uint32_t lanes = rays->active, blended = find_blended(state, rays, hits);
        for (uint32_t left = lanes; left; left &= left - 1) {
            int lane = __builtin_ctz(left);
            double coverage = blended >> lane & 1 ? find_coverage(mesh, place_of(state), rays, lane,
                                                                  hits->triangle[lane], 0)
                                                  : INFINITY;
            float opacity = coverage < 2.0 ? 0.5f * (float)coverage : 1.0f;
            part[lane] = passing[lane] * opacity;
            passing[lane] *= 1.0f - opacity;
            if (opacity == 1.0f)
                rays->active &= ~(1u << lane);
        }
        memcpy(begin, rays->limit, sizeof begin);
        add_parts(lanes, layer, part, light, radiance);
        if (clear)
            add_parts(lanes, layer, part, clear_light, clear);
        if (!lost)
            continue;
        set_lanes(layer_lost.radiance, ~layer_lost.rays, (Vec3){0, 0, 0});
        add_parts(lanes, layer, part, layer_lost.radiance, lost->radiance);
        lost->rays |= lanes & layer_lost.rays;
    }
}

/* Shade and fog what a block's rays show, blended facets included; and take down the motion of
 * these for the plan of a `tile`, unless that is NO_PLAN. */
static void shade_in_fog(const FrameState *state, int tile, const RayBlock *rays,
                         const HitBlock *hits, const TileContent *content,
                         float radiance[3][BLOCK_RAYS], LostLight *lost,
                         float clear[3][BLOCK_RAYS]) {
    if (!may_blend(state, content)) {
        shade_hits(state, tile, rays, hits, content, radiance, lost, clear);
        return;
    }
    RayBlock rest = *rays, front = *rays;
    HitBlock layer;
    find_layer(state, NULL, LEAST_LAYER, content->object, &front, &layer);
    front.active = find_blended(state, &front, &layer);
    rest.active &= ~front.active;
    if (rest.active)
        shade_hits(state, tile, &rest, hits, content, radiance, lost, clear);
    shade_layers(state, tile, content->object, &front, &layer, radiance, lost, clear);
}

/* Shade what the watched object hides from some rays of a block, `source` as they were loaded; and
 * what of it shadows take. */
static void shade_hidden(const FrameState *state, const RayBlock *source, uint32_t lanes,
                         const TileContent *content, float radiance[3][BLOCK_RAYS],
                         LostLight *lost) {
    FrameState without = *state;
    TileContent rest = *content;
    RayBlock rays = *source;
    HitBlock hits;
    without.unseen_object = state->frame->watched_object;
    if (rest.object == without.unseen_object)
        rest.object = OBJECT_NONE;
    rays.active = lanes;
    intersect_content(&without, &rays, &hits, &rest);
    shade_in_fog(&without, NO_PLAN, &rays, &hits, &rest, radiance, lost, NULL);
}

/* The samples of a tile without the watched object, and without shadows besides, from the first
 * block on that shows the object. */
typedef struct {
    PixelSums sums, unshadowed;
    int differs;
} Unwatched;

/* A block without the watched object, by its radiance with it; `lost` without any rays where
 * shadows are not measured. */
static void find_unwatched(const FrameState *state, const RayBlock *source, uint32_t watched,
                           const TileContent *content, float radiance[3][BLOCK_RAYS],
                           const LostLight *lost, float shadowed[3][BLOCK_RAYS],
                           float lit[3][BLOCK_RAYS]) {
    int is_measured = finds_shadow_change(state);
    _Alignas(64) float hidden[3][BLOCK_RAYS];
    LostLight hidden_lost = {.rays = 0};
    if (watched)
        shade_hidden(state, source, watched, content, hidden, is_measured ? &hidden_lost : NULL);
    for (int channel = 0; channel < 3; channel++)
        for (int lane = 0; lane < BLOCK_RAYS; lane++) {
            int is_watched = watched >> lane & 1;
            const LostLight *own = is_watched ? &hidden_lost : lost;
            float light = is_watched ? hidden[channel][lane] : radiance[channel][lane];
            shadowed[channel][lane] = light;
            lit[channel][lane] =
                light + (own->rays >> lane & 1 ? own->radiance[channel][lane] : 0.0f);
        }
}

/* The change by the watched object between sums of a tile's samples: under shadows, those behind it
 * with its own or without; and in their absence. */
static void note_watched(const FrameState *state, int tile, const PixelSums *sums,
                         const PixelSums *unshadowed, const Unwatched *unwatched) {
    const PixelSums *with[3] = {sums, sums, unshadowed};
    const PixelSums *without[3] = {&unwatched->sums, &unwatched->unshadowed,
                                   &unwatched->unshadowed};
    int is_measured = finds_shadow_change(state);
    note_largest_changes(state, tile, &state->measures->watched, is_measured ? 3 : 1, with,
                         without);
}

/* The samples of a tile without shadows, from the first block on that has any. */
typedef struct {
    PixelSums sums;
    int differs;
} Unshadowed;

static void add_unshadowed(const FrameState *state, int block, uint32_t active,
                           float radiance[3][BLOCK_RAYS], const LostLight *lost,
                           const PixelSums *before, Unshadowed *unshadowed) {
    if (!unshadowed->differs && !lost->rays)
        return;
    if (!unshadowed->differs && block)
        unshadowed->sums = *before;
    unshadowed->differs = 1;
    float sum[3][BLOCK_RAYS];
    for (int channel = 0; channel < 3; channel++)
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            sum[channel][lane] =
                radiance[channel][lane] +
                (lost->rays >> lane & 1 ? lost->radiance[channel][lane] : 0.0f);
    add_samples(state, block, active, sum, &unshadowed->sums);
}

static void add_unwatched(const FrameState *state, int block, size_t index, uint32_t watched,
                          const TileContent *content, float radiance[3][BLOCK_RAYS],
                          const LostLight *lost, const PixelSums *before,
                          const Unshadowed *unshadowed, Unwatched *unwatched) {
    float shadowed[3][BLOCK_RAYS], lit[3][BLOCK_RAYS];
    RayBlock source;
    load_block(state, index, &source);
    if (!unwatched->differs && block) {
        unwatched->sums = *before;
        unwatched->unshadowed = unshadowed->differs ? unshadowed->sums : *before;
    }
    unwatched->differs = 1;
    find_unwatched(state, &source, watched, content, radiance, lost, shadowed, lit);
    add_samples(state, block, source.active, shadowed, &unwatched->sums);
    add_samples(state, block, source.active, lit, &unwatched->unshadowed);
}

/* Means of a tile's samples into the image, and into the plan of a moving frame; with the sums of
 * inverse ranges, if these are wanted. */
static void finish_tile(const FrameState *state, int tile, const PixelSums *sums,
                        const float inverse_sums[TILE_PX * TILE_PX]) {
    write_pixels(state, tile, sums);
    if (state->frame->inverse_range)
        write_ranges(state, tile, inverse_sums);
    if (!state->plan)
        return;
    float factor = 1.0f / (float)(state->rays->samples * state->rays->samples);
    float means[3][TILE_PX * TILE_PX];
    for (int channel = 0; channel < 3; channel++)
        for (int pixel = 0; pixel < TILE_PX * TILE_PX; pixel++)
            means[channel][pixel] = factor * sums->sum[channel][pixel];
    note_means(state, tile, (const float(*)[TILE_PX * TILE_PX])means);
}

void load_unit(const FrameState *state, int tile, const RayOrder *order, int unit, int block,
               RayBlock *rays) {
    if (order->is_table)
        load_block(state, (size_t)tile * (size_t)order->units + (size_t)unit, rays);
    else
        load_ordered(state, tile, unit_source(order, unit, block), rays);
}

uint32_t sample_block(const FrameState *state, int tile, const RayOrder *order, int unit, int block,
                      const TileContent *content, float radiance[3][BLOCK_RAYS],
                      LostLight *lost) {
    RayBlock rays;
    HitBlock hits;
    if (lost)
        lost->rays = 0;
    load_unit(state, tile, order, unit, block, &rays);
    if (rays.active) {
        find_hits(state, &rays, &hits, content);
        shade_in_fog(state, NO_PLAN, &rays, &hits, content, radiance, lost, NULL);
    }
    return rays.active;
}

TileContent move_content(const FrameState *state, const TileContent *content, ShortList *moved) {
    TileContent result = *content;
    if (content->short_list)
        result.short_list =
            move_short_list(content->short_list, &state->camera, moved) ? moved : NULL;
    return result;
}

/* Sums of a tile's samples, without shadows, in clear air, without the watched object, and of their
 * inverse ranges. */
typedef struct {
    PixelSums sums, unshadowed, clear;
    Unwatched unwatched;
    float inverse[TILE_PX * TILE_PX];
    int differs; /* those without shadows do */
} RowSums;

static void add_row_block(const FrameState *state, int tile, int row, const RayBlock *source,
                          const RayBlock *rays, const HitBlock *hits, uint32_t watched,
                          const TileContent *content, RowSums *result) {
    _Alignas(64) float radiance[3][BLOCK_RAYS];
    LostLight lost = {.rays = 0};
    int is_measured = finds_shadow_change(state);
    float clear[3][BLOCK_RAYS];
    shade_in_fog(state, tile, rays, hits, content, radiance, is_measured ? &lost : NULL,
                 measures_fog(state) ? clear : NULL);
    if (measures_fog(state))
        add_row(row, rays->active, clear, &result->clear);
    if (find_watched(state)) {
        float shadowed[3][BLOCK_RAYS], lit[3][BLOCK_RAYS];
        find_unwatched(state, source, watched, content, radiance, &lost, shadowed, lit);
        add_row(row, rays->active, shadowed, &result->unwatched.sums);
        add_row(row, rays->active, lit, &result->unwatched.unshadowed);
        result->unwatched.differs |= watched != 0;
    }
    add_row(row, rays->active, radiance, &result->sums);
    result->differs |= lost.rays != 0;
    for (int lane = 0; is_measured && lane < BLOCK_RAYS; lane++)
        if (lost.rays >> lane & 1)
            add_lane(radiance, lane,
                     get_lane((const float(*)[BLOCK_RAYS])lost.radiance, lane));
    if (is_measured)
        add_row(row, rays->active, radiance, &result->unshadowed);
    if (!state->frame->inverse_range)
        return;
    float inverse[BLOCK_RAYS];
    find_inverse_ranges(rays, hits, inverse);
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        result->inverse[row * TILE_PX + lane % TILE_PX] += inverse[lane];
}

/* Samples of a rolling shutter: each row of pixels at its own time. */
static void render_rows(const FrameState *state, int tile, const TileContent *content) {
    const RayOrder *order = &state->view->by_row;
    int top = state->rays->tiles[tile] / state->rays->tile_columns * TILE_PX;
    RowSums sums;
    memset(&sums, 0, sizeof sums);
    for (int row = 0; row < TILE_PX; row++) {
        FrameState moved = at_instant(state, row_time(state, (float)(top + row) + 0.5f));
        ShortList short_list;
        TileContent here = move_content(&moved, content, &short_list);
        for (int block = 0; block < order->blocks; block++) {
            RayBlock rays;
            HitBlock hits;
            load_ordered(&moved, tile, unit_source(order, row, block), &rays);
            if (!rays.active)
                continue;
            RayBlock source = rays;
            uint32_t watched = find_hits(&moved, &rays, &hits, &here);
            note_hits(&moved, tile, &rays, &hits);
            add_row_block(&moved, tile, row, &source, &rays, &hits, watched, &here, &sums);
        }
    }
    finish_tile(state, tile, &sums.sums, sums.inverse);
    if (measures_fog(state))
        note_changes(state, tile, &state->measures->fog, &sums.sums, &sums.clear);
    if (sums.differs)
        note_changes(state, tile, &state->measures->shadow, &sums.sums, &sums.unshadowed);
    if (sums.unwatched.differs)
        note_watched(state, tile, &sums.sums, &sums.unshadowed, &sums.unwatched);
}

static void render_samples(const FrameState *state, int tile, const TileContent *content,
                           TileLabels *labels) {
    int blocks = state->rays->samples * state->rays->samples;
    int has_ranges = state->frame->inverse_range != NULL;
    float inverse[BLOCK_RAYS], inverse_sums[TILE_PX * TILE_PX] = {0};
    PixelSums sums, clear_sums;
    Unshadowed unshadowed = {.differs = 0};
    Unwatched unwatched = {.differs = 0};
    int is_measured = finds_shadow_change(state);
    for (int block = 0; block < blocks; block++) {
        size_t index = (size_t)tile * (size_t)blocks + (size_t)block;
        RayBlock rays;
        HitBlock hits;
        _Alignas(64) float radiance[3][BLOCK_RAYS];
        load_block(state, index, &rays);
        uint32_t watched = find_hits(state, &rays, &hits, content);
        if (labels)
            count_samples(state, block, rays.active, &hits, labels);
        if (blocks == 1 && !watched && has_table_colours(state, &rays, &hits)) {
            write_table_colours(state, tile, rays.active, &hits);
            return;
        }
        if (state->plan)
            note_hits(state, tile, &rays, &hits);
        LostLight lost = {.rays = 0};
        float clear[3][BLOCK_RAYS];
        shade_in_fog(state, tile, &rays, &hits, content, radiance, is_measured ? &lost : NULL,
                     measures_fog(state) ? clear : NULL);
        if (measures_fog(state))
            add_samples(state, block, rays.active, clear, &clear_sums);
        if (watched || unwatched.differs)
            add_unwatched(state, block, index, watched, content, radiance, &lost, &sums,
                          &unshadowed, &unwatched);
        if (is_measured)
            add_unshadowed(state, block, rays.active, radiance, &lost, &sums, &unshadowed);
        add_samples(state, block, rays.active, radiance, &sums);
        if (state->plan)
            note_block(state, tile, block, radiance);
        if (!has_ranges)
            continue;
        find_inverse_ranges(&rays, &hits, inverse);
        add_lanes(state->rays->samples, block, inverse, inverse_sums);
    }
    finish_tile(state, tile, &sums, inverse_sums);
    if (measures_fog(state))
        note_changes(state, tile, &state->measures->fog, &sums, &clear_sums);
    if (unshadowed.differs)
        note_changes(state, tile, &state->measures->shadow, &sums, &unshadowed.sums);
    if (unwatched.differs)
        note_watched(state, tile, &sums, unshadowed.differs ? &unshadowed.sums : &sums, &unwatched);
}

static void identify_samples(const FrameState *state, int tile) {
    int blocks = state->rays->samples * state->rays->samples;
    for (int block = 0; block < blocks; block++) {
        size_t index = (size_t)tile * (size_t)blocks + (size_t)block;
        RayBlock rays;
        HitBlock hits;
        load_block(state, index, &rays);
        find_hits(state, &rays, &hits, &UNKNOWN_CONTENT);
        store_hits(state, index, &rays, &hits);
    }
}

static int may_fill(const FrameState *state, int tile, const TileContent *content) {
    return content->triangle != SURFACE_UNKNOWN && content->object == OBJECT_NONE &&
           is_wholly_valid(state, tile);
}

int is_single_radiance(const FrameState *state, int tile, const TileContent *content) {
    PlaneLight light;
    size_t entry;
    /* Fog differs from ray to ray. */
    return !(has_fog(state) && content->triangle >= 0) && may_fill(state, tile, content) &&
           find_single_radiance(state, content, &light, &entry);
}

/* Texels of so many blocks are on their way while those of an earlier one are mixed: a tile of 2 x 2
 * samples at once. */
enum { PLACED_BLOCKS = 4 };

/* Sums of a facet's texture over the samples of a tile's pixels. */
static void sum_texels(const FrameState *state, int tile, const TileContent *content,
                       PixelSums *sums) {
    int blocks = state->rays->samples * state->rays->samples;
    PlacedTexels placed[PLACED_BLOCKS];
    for (int block = 0; block < blocks + PLACED_BLOCKS - 1; block++) {
        int before = block - (PLACED_BLOCKS - 1);
        _Alignas(64) float colours[3][BLOCK_RAYS];
        if (block < blocks) {
            RayBlock rays;
            load_block(state, (size_t)tile * (size_t)blocks + (size_t)block, &rays);
            place_plane_texels(state, content->triangle, content->plane, &rays,
                               &placed[block % PLACED_BLOCKS]);
        }
        if (before < 0 || before >= blocks)
            continue;
        mix_textures(&placed[before % PLACED_BLOCKS], colours);
        add_samples(state, before, 0xffff, colours, sums);
    }
}

/* Light of a textured tile: sums of texels times one light, and that without shadows; less, of the
 * sky's light, what factors of the pixels take. */
static void light_sums(const FrameState *state, const TileContent *content, const PlaneLight *light,
                       const PixelSums *texels, PixelSums *sums, PixelSums *unshadowed) {
    const float *ambient = state->scene->ambient_radiance + 3 * (size_t)content->triangle;
    float whole[3] = {light->radiance.x, light->radiance.y, light->radiance.z};
    float lost[3] = {light->lost.x, light->lost.y, light->lost.z};
    float part = 1.0f / (float)(state->rays->samples * state->rays->samples);
    _Alignas(64) float lit[3][BLOCK_RAYS], sky[3][BLOCK_RAYS];
    for (int channel = 0; channel < 3; channel++) {
        Floats16 sum = load16(texels->sum[channel]), here = splat16(whole[channel]);
        if (content->factors)
            here -= (1.0f - load16(content->factors[channel])) * ambient[channel];
        store16(sum * here, sums->sum[channel]);
        store16(sum * (here + lost[channel]), unshadowed->sum[channel]);
        store16(part * load16(sums->sum[channel]), lit[channel]);
        store16(part * ambient[channel] * sum, sky[channel]);
    }
    if (content->factors)
        note_light(state, content->triangle, 0xffff, (const float(*)[BLOCK_RAYS])lit,
                   (const float(*)[BLOCK_RAYS])sky, content->factors);
}

/* Draw a tile of one radiance, with factors of its pixels, times a texture; 0 if it has several, or
 * more is wanted of it. */
static int fill_textured_tile(const FrameState *state, int tile, const TileContent *content) {
    PlaneLight light;
    PixelSums texels, sums, unshadowed;
    if (content->triangle < 0 || state->plan || has_fog(state) ||
        !may_fill(state, tile, content) || is_glossy(state, content->triangle) ||
        !(state->scene->mesh->arrays.flags[content->triangle] & FACET_TEXTURED) ||
        !(content->factors ||
          (!content->is_shaded &&
           (content->is_open || !has_occlusion(state->scene, content->triangle)))) ||
        !find_plane_light(state, content->triangle, content->proof, &light))
        return 0;
    sum_texels(state, tile, content, &texels);
    light_sums(state, content, &light, &texels, &sums, &unshadowed);
    if (finds_shadow_change(state) && max_abs(light.lost) > 0.0f)
        note_changes(state, tile, &state->measures->shadow, &sums, &unshadowed);
    write_pixels(state, tile, &sums);
    fill_ranges(state, tile, content->triangle);
    return 1;
}

/* Draw a tile of clear sky; 0 if it shows more, or more is wanted of it. */
static int fill_sky_tile(const FrameState *state, int tile, const TileContent *content) {
    int blocks = state->rays->samples * state->rays->samples;
    PixelSums sums;
    if (content->triangle != SURFACE_BACKGROUND || !state->scene->sky || state->plan ||
        has_fog(state) || !may_fill(state, tile, content))
        return 0;
    for (int block = 0; block < blocks; block++) {
        _Alignas(64) float radiance[3][BLOCK_RAYS];
        RayBlock rays;
        load_block(state, (size_t)tile * (size_t)blocks + (size_t)block, &rays);
        show_sky(state->scene, &rays, 0xffff, radiance);
        add_samples(state, block, 0xffff, radiance, &sums);
    }
    write_pixels(state, tile, &sums);
    fill_ranges(state, tile, content->triangle);
    return 1;
}

/* Draw a tile of one radiance, in one air; 0 if it has several. */
static int fill_single_tile(const FrameState *state, int tile, const TileContent *content) {
    PlaneLight light;
    size_t entry;
    if (!may_fill(state, tile, content) || !find_single_radiance(state, content, &light, &entry))
        return 0;
    if (!has_fog(state) || content->triangle < 0) {
        fill_tile(state, tile, content, entry, &light);
        return 1;
    }
    if (!is_fogged_as_one(state, tile) ||
        (finds_shadow_change(state) && max_abs(light.lost) > 0.0f))
        return 0;
    fill_fogged_tile(state, tile, content->triangle, light.radiance);
    return 1;
}

void render_tile(const FrameState *state, int tile, const TileContent *content) {
    switch (state->frame->output) {
    case OUTPUT_HITS:
        identify_samples(state, tile);
        return;
    case OUTPUT_LABELS:
        label_tile(state, tile, content);
        return;
    case OUTPUT_FLOW:
        flow_tile(state, tile);
        return;
    }
    if (fill_single_tile(state, tile, content) || fill_sky_tile(state, tile, content)) {
        if (state->frame->labels)
            label_filled_tile(state, tile, content);
        return;
    }
    TileContent known = *content;
    FacetPlane plane;
    if (content->triangle >= 0) {
        plane = find_facet_plane(state, content->triangle);
        known.plane = &plane;
    }
    if (fill_textured_tile(state, tile, &known)) {
        if (state->frame->labels)
            label_filled_tile(state, tile, content);
        return;
    }
    TileLabels labels;
    _Alignas(64) float mirrored[3][BLOCK_RAYS];
    /* What shadows take of mirrored light is measured by samples. */
    int measures_lost = finds_shadow_change(state);
    if (!state->is_rolling && !measures_lost && content->triangle >= 0 &&
        content->object == OBJECT_NONE && is_wholly_valid(state, tile) &&
        is_glossy(state, content->triangle) &&
        mirror_pixels(state, tile, content->triangle, mirrored))
        known.mirrored = (const float(*)[BLOCK_RAYS])mirrored;
    if (state->frame->labels)
        label_centres(state, tile, content, &labels);
    if (state->is_rolling)
        render_rows(state, tile, &known);
    else
        render_samples(state, tile, &known, state->frame->labels ? &labels : NULL);
    if (state->plan && content->may_be_thin)
        note_thin(state, tile);
    if (state->frame->labels)
        write_agreement(state, tile, &labels);
}
