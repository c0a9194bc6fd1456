#include "tiles.h"

#include "facet_plane.h"
#include "hit_points.h"
#include "light_map.h"
#include "shading.h"

#include <math.h>
#include <string.h>

/* Radiance of all samples of a tile, as a grid of (4 samples)^2. */
typedef struct {
    Vec3 radiance[TILE_PX * MAX_SAMPLES][TILE_PX * MAX_SAMPLES];
} SampleGrid;

/* World directions and origins of a block whose rays share one pose. */
static void place_rays(const FrameState *state, size_t block, RayBlock *rays) {
    const Pose *pose = state->frame->camera;
    const float *from = state->rays->directions + block * 3 * BLOCK_RAYS;
    const float *r = pose->rotation;
    for (int axis = 0; axis < 3; axis++)
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            rays->direction[axis][lane] = r[3 * axis] * from[lane] +
                                          r[3 * axis + 1] * from[BLOCK_RAYS + lane] +
                                          r[3 * axis + 2] * from[2 * BLOCK_RAYS + lane];
    for (int axis = 0; axis < 3; axis++)
        for (int lane = 0; lane < BLOCK_RAYS; lane++)
            rays->origin[axis][lane] = pose->translation[axis];
    memset(rays->time, 0, sizeof rays->time);
}

/* The same for rays with origins or times of their own. */
static void place_rays_singly(const FrameState *state, size_t block, RayBlock *rays) {
    const RayTable *table = state->rays;
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        size_t at = block * 3 * BLOCK_RAYS + (size_t)lane;
        Pose pose;
        rays->time[lane] = table->times ? table->times[block * BLOCK_RAYS + (size_t)lane] : 0.0f;
        pose_at(state->frame->camera, state->frame->num_poses, 1, rays->time[lane], &pose);
        Vec3 direction = {table->directions[at], table->directions[at + BLOCK_RAYS],
                          table->directions[at + 2 * BLOCK_RAYS]};
        Vec3 origin = {0, 0, 0};
        if (table->origins)
            origin = (Vec3){table->origins[at], table->origins[at + BLOCK_RAYS],
                            table->origins[at + 2 * BLOCK_RAYS]};
        direction = rotate(pose.rotation, direction);
        /* Between two poses a rotation's entries shorten: distances are metres of unit rays. */
        direction = scale(1.0f / sqrtf(dot(direction, direction)), direction);
        origin = add(rotate(pose.rotation, origin), vec3(pose.translation));
        rays->direction[0][lane] = direction.x;
        rays->direction[1][lane] = direction.y;
        rays->direction[2][lane] = direction.z;
        rays->origin[0][lane] = origin.x;
        rays->origin[1][lane] = origin.y;
        rays->origin[2][lane] = origin.z;
    }
}

static void load_block(const FrameState *state, size_t block, RayBlock *rays) {
    if (state->rays->origins || state->rays->times)
        place_rays_singly(state, block, rays);
    else
        place_rays(state, block, rays);
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        rays->limit[lane] = INFINITY;
    rays->active = state->rays->valid[block];
}

static void clear_hits(HitBlock *hits) {
    memset(hits->triangle, 0xff, sizeof hits->triangle);
    memset(hits->object, 0xff, sizeof hits->object);
}

/* The hits of rays that all meet one facet's plane; their distances limit the rays. */
static void set_hits(const FrameState *state, RayBlock *rays, HitBlock *hits, int32_t triangle) {
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        hits->triangle[lane] = triangle;
        hits->object[lane] = OBJECT_STATIC;
    }
    FacetPlane plane = find_facet_plane(state, triangle);
    find_distances(&plane, rays, rays->limit);
}

static void find_hits(const FrameState *state, RayBlock *rays, HitBlock *hits,
                      const TileContent *content) {
    int may_show_objects = state->objects && content->may_show_objects;
    clear_hits(hits);
    if (content->triangle == SURFACE_UNKNOWN && state->scene->mesh->scene)
        intersect_block(state->device, state->scene->mesh->scene, 0, rays, hits);
    else if (content->triangle >= 0)
        set_hits(state, rays, hits, content->triangle);
    /* The scene's hits limit the rays: only nearer objects overwrite them. */
    if (may_show_objects)
        intersect_block(state->device, state->objects, 1, rays, hits);
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
        frame->range_m[at] = is_met ? points.distance[lane] : INFINITY;
        frame->triangle[at] = is_met ? hits->triangle[lane] : -1;
        frame->object[at] = is_met ? hits->object[lane] : OBJECT_NONE;
    }
}

/* Values between 0 and 1; what is not a number is black. */
static inline float clip(float value) { return value > 0.0f ? value < 1.0f ? value : 1.0f : 0.0f; }

static inline Vec3 clip3(Vec3 a) { return (Vec3){clip(a.x), clip(a.y), clip(a.z)}; }

static inline uint8_t encode(const FrameState *state, float linear) {
    return state->scene->srgb_table[(int32_t)(clip(linear) * 65535.0f + 0.5f)];
}

/* The pixels of a tile within the image: the last row and column of tiles may reach beyond. */
typedef struct {
    char *first; /* first channel of the tile's first pixel */
    size_t row_bytes, pixel_bytes;
    int rows, columns;
} TilePixels;

static TilePixels find_pixels(const FrameState *state, int tile) {
    const RayTable *table = state->rays;
    int32_t number = table->tiles[tile];
    int top = number / table->tile_columns * TILE_PX, left = number % table->tile_columns * TILE_PX;
    size_t pixel_bytes = state->frame->output == OUTPUT_LINEAR ? 3 * sizeof(float) : 3;
    size_t row_bytes = (size_t)table->width_px * pixel_bytes;
    int rows = table->height_px - top, columns = table->width_px - left;
    return (TilePixels){
        .first = (char *)state->frame->image + (size_t)top * row_bytes + (size_t)left * pixel_bytes,
        .row_bytes = row_bytes,
        .pixel_bytes = pixel_bytes,
        .rows = rows < TILE_PX ? rows : TILE_PX,
        .columns = columns < TILE_PX ? columns : TILE_PX,
    };
}

static inline char *pixel_at(const TilePixels *pixels, int row, int column) {
    return pixels->first + (size_t)row * pixels->row_bytes + (size_t)column * pixels->pixel_bytes;
}

static inline void write_mean(const FrameState *state, char *pixel, Vec3 mean) {
    if (state->frame->output == OUTPUT_LINEAR) {
        memcpy(pixel, &mean, 3 * sizeof(float));
        return;
    }
    pixel[0] = (char)encode(state, mean.x);
    pixel[1] = (char)encode(state, mean.y);
    pixel[2] = (char)encode(state, mean.z);
}

static inline void write_encoded(char *pixel, uint32_t rgb) {
    pixel[0] = (char)rgb;
    pixel[1] = (char)(rgb >> 8);
    pixel[2] = (char)(rgb >> 16);
}

/* Mean of a pixel's samples, summed row by row. */
static Vec3 mean_of_pixel(const SampleGrid *grid, int samples, int row, int column) {
    Vec3 sum = {0, 0, 0};
    for (int y = row * samples; y < (row + 1) * samples; y++)
        for (int x = column * samples; x < (column + 1) * samples; x++)
            sum = add(sum, grid->radiance[y][x]);
    return scale(1.0f / (float)(samples * samples), sum);
}

static void write_pixels(const FrameState *state, int tile, const SampleGrid *grid) {
    TilePixels pixels = find_pixels(state, tile);
    for (int row = 0; row < pixels.rows; row++)
        for (int column = 0; column < pixels.columns; column++)
            write_mean(state, pixel_at(&pixels, row, column),
                       mean_of_pixel(grid, state->rays->samples, row, column));
}

static void store_radiance(const FrameState *state, int block, uint32_t active,
                           const Vec3 *radiance, SampleGrid *grid) {
    int samples = state->rays->samples;
    int top = block / samples * TILE_PX, left = block % samples * TILE_PX;
    for (int lane = 0; lane < BLOCK_RAYS; lane++) {
        Vec3 *sample = &grid->radiance[top + lane / TILE_PX][left + lane % TILE_PX];
        /* Samples beside the mirror are black; a sensor clips, linear light does not. */
        if (!(active >> lane & 1))
            *sample = (Vec3){0, 0, 0};
        else
            *sample = state->frame->output == OUTPUT_SRGB ? clip3(radiance[lane]) : radiance[lane];
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

static int has_table_colours(const FrameState *state, const HitBlock *hits) {
    int meets_object = 0;
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        meets_object |= hits->object[lane] > OBJECT_STATIC;
    return state->is_constant && state->frame->output == OUTPUT_SRGB &&
           (!meets_object || state->object_radiance);
}

static int is_wholly_valid(const FrameState *state, int tile) {
    int blocks = state->rays->samples * state->rays->samples;
    for (int block = 0; block < blocks; block++)
        if (state->rays->valid[(size_t)tile * (size_t)blocks + (size_t)block] != 0xffff)
            return 0;
    return 1;
}

/* A tile of one radiance: no ray, no sum. */
static void fill_tile(const FrameState *state, int tile, size_t entry) {
    const Scene *scene = state->scene;
    TilePixels pixels = find_pixels(state, tile);
    char row_of_pixels[TILE_PX * 3 * sizeof(float)];
    for (int column = 0; column < TILE_PX; column++) {
        char *pixel = row_of_pixels + (size_t)column * pixels.pixel_bytes;
        if (state->frame->output == OUTPUT_LINEAR)
            write_mean(state, pixel, vec3(scene->sharp_radiance + 3 * entry));
        else
            write_encoded(pixel, scene->encoded[entry]);
    }
    for (int row = 0; row < pixels.rows; row++)
        memcpy(pixel_at(&pixels, row, 0), row_of_pixels,
               (size_t)pixels.columns * pixels.pixel_bytes);
}

/* Row of the radiance table if that is all that a tile shows, -1 otherwise. */
static int64_t find_single_radiance(const FrameState *state, int32_t triangle, int is_unshadowed) {
    const MeshArrays *mesh = &state->scene->mesh->arrays;
    if (triangle == SURFACE_BACKGROUND)
        return mesh->num_triangles;
    int is_textured = mesh->flags[triangle] & FACET_TEXTURED;
    return !is_textured && has_constant_light(state, triangle, is_unshadowed) ? triangle : -1;
}

/* Where a ray of a tile meets a facet's plane. */
static Vec3 meet_plane(const FrameState *state, const FacetPlane *plane, size_t block, int lane) {
    const Pose *pose = state->frame->camera;
    const float *from = state->rays->directions + block * 3 * BLOCK_RAYS + lane;
    Vec3 direction = rotate(pose->rotation,
                            (Vec3){from[0], from[BLOCK_RAYS], from[2 * BLOCK_RAYS]});
    Vec3 origin = vec3(pose->translation);
    float height = dot(plane->normal, subtract(plane->first, origin));
    return add(origin, scale(height / dot(plane->normal, direction), direction));
}

/* Whether no light is occluded anywhere on a block that a facet's plane fills. */
static int is_block_lit(const FrameState *state, int32_t triangle, size_t block) {
    if (!state->frame->has_shadows || !state->scene->light_maps || triangle < 0)
        return 0;
    FacetPlane plane = find_facet_plane(state, triangle);
    Vec3 corners[4] = {
        meet_plane(state, &plane, block, 0),
        meet_plane(state, &plane, block, TILE_PX - 1),
        meet_plane(state, &plane, block, BLOCK_RAYS - TILE_PX),
        meet_plane(state, &plane, block, BLOCK_RAYS - 1),
    };
    return is_quad_lit(state, triangle, corners);
}

static void set_all(Vec3 *radiance, Vec3 value) {
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        radiance[lane] = value;
}

/* Triangle that all rays of a block meet, or SURFACE_UNKNOWN. */
static int32_t find_common_triangle(const RayBlock *rays, const HitBlock *hits) {
    for (int lane = 0; lane < BLOCK_RAYS; lane++)
        if (hits->object[lane] != OBJECT_STATIC || hits->triangle[lane] != hits->triangle[0])
            return SURFACE_UNKNOWN;
    return rays->active == 0xffff ? hits->triangle[0] : SURFACE_UNKNOWN;
}

static void shade(const FrameState *state, size_t block, const RayBlock *rays,
                  const HitBlock *hits, int is_unshadowed, Vec3 *radiance) {
    int32_t triangle = state->has_one_origin ? find_common_triangle(rays, hits) : SURFACE_UNKNOWN;
    is_unshadowed = is_unshadowed || is_block_lit(state, triangle, block);
    if (triangle < 0 || !has_constant_light(state, triangle, is_unshadowed)) {
        shade_block(state, rays, hits, radiance);
        return;
    }
    Vec3 light = constant_radiance(state, triangle, is_unshadowed);
    if (state->scene->mesh->arrays.flags[triangle] & FACET_TEXTURED) {
        FacetPlane plane = find_facet_plane(state, triangle);
        texture_block(state, triangle, &plane, rays, light, radiance);
    } else {
        set_all(radiance, light);
    }
}

static void render_samples(const FrameState *state, int tile, const TileContent *content) {
    int blocks = state->rays->samples * state->rays->samples;
    SampleGrid grid;
    for (int block = 0; block < blocks; block++) {
        size_t index = (size_t)tile * (size_t)blocks + (size_t)block;
        RayBlock rays;
        HitBlock hits;
        Vec3 radiance[BLOCK_RAYS];
        load_block(state, index, &rays);
        find_hits(state, &rays, &hits, content);
        if (blocks == 1 && has_table_colours(state, &hits)) {
            write_table_colours(state, tile, rays.active, &hits);
            return;
        }
        shade(state, index, &rays, &hits, content->is_unshadowed, radiance);
        store_radiance(state, block, rays.active, radiance, &grid);
    }
    write_pixels(state, tile, &grid);
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

void render_tile(const FrameState *state, int tile, const TileContent *content) {
    if (state->frame->output == OUTPUT_HITS) {
        identify_samples(state, tile);
        return;
    }
    int32_t triangle = content->triangle;
    int may_fill = triangle != SURFACE_UNKNOWN && is_wholly_valid(state, tile) &&
                   !(state->objects && content->may_show_objects);
    int64_t entry =
        may_fill ? find_single_radiance(state, triangle, content->is_unshadowed) : -1;
    if (entry >= 0)
        fill_tile(state, tile, (size_t)entry);
    else
        render_samples(state, tile, content);
}
