/* Provides blur.h: tiles at several instants of their exposure, averaged.
 * Float64 twin: render/renderer.py:sample_shutter and reference/reference_engine.py, the mean of
 * sharp frames. Owns nothing: sums are on the stack, means are the plan's.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "blur.h"

#include "blur_plan.h"
#include "fog.h"
#include "measures.h"
#include "occlusion.h"
#include "pixels.h"
#include "plane_light.h"

#include <math.h>
#include <string.h>

/* A unit is finished when twice as many instants change no pixel by more, in grey levels, or by
 * more than a quarter of what may be left out: where edges pass samples more may be left than the
 * last change, 2.7 times as much. Measured in tests/server/render/trace/test_engine_shutter.py. */
#define TOLERANCE 3.5f
/* The same for the first division, which is compared with the sharp frame: where texture and light
 * differ by little at three instants they differ by little between these. */
#define FIRST_TOLERANCE 1.5f

/* Square of what an exposure shows of a plane, relative to the distance of a lamp: light is at most
 * 12 times as curved, and a mean deviates by a 24th of that. */
#define MAX_EVEN_SIZE 2e-3f

/* The pixels of one unit, and the sums over the instants so far. */
typedef struct {
    int is_wanted, is_active, is_changed;
    uint32_t shadowed; /* pixels whose shadows are visible at some instant */
    float ends[3][TILE_PX * TILE_PX];   /* of the first and the last instant */
    float inner[3][TILE_PX * TILE_PX];  /* of all between, the sharp frame's included */
    float mean[3][TILE_PX * TILE_PX];   /* trapezoidal rule */
} Unit;

typedef struct {
    const FrameState *state;
    int tile, top;
    const RayOrder *order;
    const TileContent *content;
    Unit units[MAX_UNITS];
    int64_t *num_rays;
} BlurTile;

static float sharp_mean(const BlurTile *blur, int unit, int channel, int pixel) {
    return blur->state->plan->means[((size_t)blur->tile * 3 + (size_t)channel) * BLOCK_RAYS +
                                    blur->order->pixel[unit][pixel]];
}

static void find_sharp(const BlurTile *blur, int unit, float sharp[3][TILE_PX * TILE_PX]) {
    memset(sharp, 0, sizeof(float) * 3 * TILE_PX * TILE_PX);
    for (int channel = 0; channel < 3; channel++)
        for (int pixel = 0; pixel < blur->order->pixels; pixel++)
            sharp[channel][pixel] = sharp_mean(blur, unit, channel, pixel);
}

/* Largest change of a unit's pixels, of which all others are 0. */
static float find_unit_change(const BlurTile *blur, const float one[3][TILE_PX * TILE_PX],
                              const float other[3][TILE_PX * TILE_PX]) {
    const Frame *frame = blur->state->frame;
    float few[2][BLOCK_RAYS] = {{0}}, changes[BLOCK_RAYS];
    for (int i = 0; i < 12; i++) {
        few[0][i] = one[i / 4][i % 4];
        few[1][i] = other[i / 4][i % 4];
    }
    if (blur->order->pixels > 4)
        find_colour_changes(frame, one, other, changes);
    else
        find_level_changes(frame, few[0], few[1], changes);
    return most_of16(load16(changes));
}

static void begin_unit(BlurTile *blur, int unit) {
    Unit *one = &blur->units[unit];
    memset(one->ends, 0, sizeof one->ends);
    find_sharp(blur, unit, one->mean);
    memcpy(one->inner, one->mean, sizeof one->inner);
}

/* A unit's pixels at one instant, with and without shadows. */
typedef struct {
    float shown[3][TILE_PX * TILE_PX], unshadowed[3][TILE_PX * TILE_PX];
    int differs;
} Instant;

/* Add what a block's samples show, and what shadows take of it. */
static void add_to_instant(const BlurTile *blur, uint32_t active,
                           float radiance[3][BLOCK_RAYS], const LostLight *lost, Instant *sums) {
    const FrameState *state = blur->state;
    float factor = 1.0f / (float)(state->rays->samples * state->rays->samples);
    uint32_t rays = active & lost->rays;
    sums->differs |= rays != 0;
    for (int channel = 0; channel < 3; channel++) {
        Floats16 zero = {0}, value = select16(mask16(active), load16(radiance[channel]), zero);
        Floats16 bright = value + select16(mask16(rays), load16(lost->radiance[channel]), zero);
        add_to_unit(blur->order, factor * value, sums->shown[channel]);
        add_to_unit(blur->order, factor * bright, sums->unshadowed[channel]);
    }
}

static void note_instant(const BlurTile *blur, const Instant *sums, Unit *one) {
    ChangeMeasure *measure = &blur->state->measures->shadow;
    if (!sums->differs)
        return;
    float changes[BLOCK_RAYS];
    find_colour_changes(blur->state->frame, sums->shown, sums->unshadowed, changes);
    raise_largest(measure, most_of16(load16(changes)));
    one->shadowed |= bits16(load16(changes) > unseen_levels(blur->state, measure));
}

/* Sums of a unit's samples at an instant, added to its means. */
static void sample_unit(BlurTile *blur, const FrameState *moved, const TileContent *content,
                        int unit, float sums[3][TILE_PX * TILE_PX]) {
    const RayOrder *order = blur->order;
    float factor = 1.0f / (float)(moved->rays->samples * moved->rays->samples);
    int is_measured = moved->measures->blurs_unseen_shadows;
    Instant instant;
    LostLight lost;
    if (is_measured)
        memset(&instant, 0, sizeof instant);
    for (int block = 0; block < order->blocks; block++) {
        _Alignas(64) float radiance[3][BLOCK_RAYS];
        uint32_t active = sample_block(moved, blur->tile, order, unit, block, content, radiance,
                                       is_measured ? &lost : NULL);
        if (is_measured)
            add_to_instant(blur, active, radiance, &lost, &instant);
        for (int channel = 0; channel < 3; channel++) {
            Floats16 value = factor * load16(radiance[channel]);
            add_to_unit(order, select16(mask16(active), value, splat16(0.0f)), sums[channel]);
        }
    }
    if (is_measured)
        note_instant(blur, &instant, &blur->units[unit]);
    *blur->num_rays += order->blocks * BLOCK_RAYS;
}

/* One instant, `phase` from -1/2 to 1/2 of the exposure, of all units that are not finished. */
static void sample_instant(BlurTile *blur, float phase, int is_end) {
    const FrameState *state = blur->state;
    FrameState moved = *state;
    ShortList short_list;
    TileContent content;
    int is_placed = 0;
    for (int unit = 0; unit < blur->order->units; unit++) {
        Unit *one = &blur->units[unit];
        if (!one->is_active)
            continue;
        if (!is_placed || state->is_rolling) {
            float centre =
                state->is_rolling ? row_time(state, (float)(blur->top + unit) + 0.5f) : 0.5f;
            moved.time = centre + phase * state->frame->exposure;
            rigid_pose_at(state->frame->camera, state->frame->num_poses, 1, moved.time,
                          &moved.camera);
            content = move_content(&moved, blur->content, &short_list);
            is_placed = 1;
        }
        sample_unit(blur, &moved, &content, unit, is_end ? one->ends : one->inner);
    }
}

/* Means by the trapezoidal rule over `steps` parts of the exposure, and their largest change. */
static float update_means(const BlurTile *blur, Unit *one, int steps) {
    float before[3][TILE_PX * TILE_PX];
    memcpy(before, one->mean, sizeof before);
    for (int channel = 0; channel < 3; channel++)
        for (int pixel = 0; pixel < blur->order->pixels; pixel++)
            one->mean[channel][pixel] =
                (one->inner[channel][pixel] + 0.5f * one->ends[channel][pixel]) / (float)steps;
    return find_unit_change(blur, one->mean, before);
}

/* Instants at all multiples of 1 / steps that no coarser division had. */
static void refine(BlurTile *blur, int steps) {
    for (int i = 1; i < steps; i += 2)
        sample_instant(blur, (float)i / (float)steps - 0.5f, 0);
}

/* Changes by less are left out. */
static float unseen_change(const Frame *frame) {
    return frame->blur_threshold > 0.0f ? 0.25f * frame->blur_threshold : 0.0f;
}

/* Halve the steps between instants until all units are finished. */
static void blur_units(BlurTile *blur, int min_steps) {
    const Frame *frame = blur->state->frame;
    int is_any = 0;
    for (int unit = 0; unit < blur->order->units; unit++)
        is_any |= blur->units[unit].is_active;
    if (!is_any)
        return;
    float unseen = unseen_change(frame);
    sample_instant(blur, -0.5f, 1);
    sample_instant(blur, 0.5f, 1);
    for (int steps = 2, active = 1; active; steps *= 2) {
        if (steps > 2)
            refine(blur, steps);
        active = 0;
        for (int unit = 0; unit < blur->order->units; unit++) {
            Unit *one = &blur->units[unit];
            if (!one->is_active)
                continue;
            float change = update_means(blur, one, steps);
            float tolerance = fmaxf(unseen, steps > 2 ? TOLERANCE : FIRST_TOLERANCE);
            int is_done = steps >= min_steps && change <= tolerance;
            one->is_changed |= steps > 2 || change > unseen;
            one->is_active = !is_done && 2 * steps <= frame->max_instants;
            active |= one->is_active;
        }
    }
}

/* Means of a unit over the exposure by its triangles' intervals; 0 if they do not tell. */
static int integrate_unit(BlurTile *blur, const FrameState *still, const MovingScene *scene,
                          int unit) {
    const RayOrder *order = blur->order;
    Unit *one = &blur->units[unit];
    float factor = 1.0f / (float)(still->rays->samples * still->rays->samples);
    float sums[3][TILE_PX * TILE_PX] = {{0}};
    for (int block = 0; block < order->blocks; block++) {
        _Alignas(64) float radiance[3][BLOCK_RAYS] = {{0}};
        RayBlock rays;
        load_unit(still, blur->tile, order, unit, block, &rays);
        if (rays.active && !integrate_block(scene, &rays, radiance))
            return 0;
        for (int channel = 0; channel < 3; channel++)
            add_to_unit(order, factor * load16(radiance[channel]), sums[channel]);
    }
    memcpy(one->mean, sums, sizeof sums);
    *blur->num_rays += order->blocks * BLOCK_RAYS * scene->parts;
    return 1;
}

/* Largest change of a unit's pixels from the sharp frame. */
static float measure_change(const BlurTile *blur, int unit) {
    float sharp[3][TILE_PX * TILE_PX];
    find_sharp(blur, unit, sharp);
    return find_unit_change(blur, blur->units[unit].mean, sharp);
}

/* What the units show during one exposure. */
typedef struct {
    MovingScene scene;
    ShortList listed;
    TileContent content; /* for rays */
    int is_known;
} Shown;

/* What the tile shows during an exposure about a time: its triangles, and for rays their list. */
static void find_shown(const BlurTile *blur, const TileContent *content, float centre, int steps,
                       Shown *shown) {
    const TriangleSet *set = content->triangles;
    shown->is_known = move_triangles(blur->state, blur->tile, set, centre, steps, &shown->scene);
    shown->content = *content;
    if (shown->is_known)
        shown->content.proofs = &shown->scene.proofs;
    if (shown->is_known && list_moving(set, &shown->scene, &shown->listed))
        shown->content.short_list = &shown->listed;
}

/* Finish a unit if it shows nothing but triangles of one radiance each. */
static void try_unit(BlurTile *blur, const FrameState *still, const Shown *shown, int unit) {
    Unit *one = &blur->units[unit];
    if (!shown->is_known || !integrate_unit(blur, still, &shown->scene, unit))
        return;
    one->is_active = 0;
    one->is_changed = measure_change(blur, unit) > unseen_change(blur->state->frame);
}

/* Units with one time of exposure by their triangles, and by rays where that does not do. */
static void blur_listed(BlurTile *blur, int steps) {
    const FrameState *state = blur->state;
    FrameState still = *state;
    still.camera = (Pose){{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}};
    Shown shown; /* not initialized: its triangles are large */
    find_shown(blur, blur->content, 0.5f, steps, &shown);
    for (int unit = 0; unit < blur->order->units; unit++)
        if (blur->units[unit].is_active)
            try_unit(blur, &still, &shown, unit);
    blur->content = &shown.content;
    blur_units(blur, steps);
}

/* The same of rows that have a time each: one after the other. */
static void blur_listed_rows(BlurTile *blur, int steps) {
    const TileContent *content = blur->content;
    FrameState still = *blur->state;
    still.camera = (Pose){{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}};
    int is_wanted[MAX_UNITS];
    for (int unit = 0; unit < blur->order->units; unit++) {
        is_wanted[unit] = blur->units[unit].is_active;
        blur->units[unit].is_active = 0;
    }
    for (int unit = 0; unit < blur->order->units; unit++) {
        if (!is_wanted[unit])
            continue;
        Shown shown;
        float centre = row_time(blur->state, (float)(blur->top + unit) + 0.5f);
        find_shown(blur, content, centre, steps, &shown);
        blur->units[unit].is_active = 1;
        try_unit(blur, &still, &shown, unit);
        blur->content = &shown.content;
        blur_units(blur, steps);
        blur->units[unit].is_active = 0;
    }
    blur->content = content;
}

/* Means of the units into the image; how much they change it. */
static void write_units(BlurTile *blur) {
    const FrameState *state = blur->state;
    PixelSums sums;
    /* write_pixels divides by the number of a sharp frame's samples. */
    float samples = (float)(state->rays->samples * state->rays->samples);
    const BlurPlan *plan = state->plan;
    int is_gathered = plan->gathered[state->rays->tiles[blur->tile]] != 0;
    float *known =
        (is_gathered ? plan->blurred : plan->means) + (size_t)blur->tile * 3 * BLOCK_RAYS;
    for (int i = 0; i < 3 * BLOCK_RAYS; i++)
        sums.sum[i / BLOCK_RAYS][i % BLOCK_RAYS] = samples * known[i];
    for (int unit = 0; unit < blur->order->units; unit++) {
        Unit *one = &blur->units[unit];
        float sharp[3][TILE_PX * TILE_PX];
        count_visible(&state->measures->shadow, __builtin_popcount(one->shadowed));
        if (!one->is_wanted)
            continue;
        find_sharp(blur, unit, sharp);
        note_samples(state, &state->measures->blur, (1u << blur->order->pixels) - 1, one->mean,
                     sharp);
        for (int pixel = 0; pixel < blur->order->pixels; pixel++) {
            int at = blur->order->pixel[unit][pixel];
            for (int channel = 0; channel < 3; channel++) {
                /* In place of gathered light, too. */
                if (one->is_changed || is_gathered)
                    sums.sum[channel][at] = samples * one->mean[channel][pixel];
                /* For the pass that draws the gathered cells. */
                if (is_gathered)
                    known[channel * BLOCK_RAYS + at] = one->mean[channel][pixel];
            }
        }
    }
    write_pixels(state, blur->tile, &sums);
}

/* Whether a unit holds pixels of the cells of 2 x 2 pixels that the plan wants. */
static int is_unit_wanted(const FrameState *state, int cells, int unit) {
    if (state->view->by_cell.units == 1)
        return 1;
    return state->is_rolling ? cells >> (unit / 2 * 2) & 3 : cells >> unit & 1;
}

/* Whether the light of a lamp on the part of a plane between four corners is even: the mean along a
 * part of it is that in the middle to a thousandth. */
static int is_even(const Light *lamp, const Vec3 corners[4]) {
    Vec3 across = subtract(corners[3], corners[0]), down = subtract(corners[2], corners[1]);
    float size = fmaxf(dot(across, across), dot(down, down));
    for (int i = 0; i < 4; i++) {
        Vec3 to_lamp = subtract(vec3(lamp->vector), corners[i]);
        if (!(size < MAX_EVEN_SIZE * dot(to_lamp, to_lamp)))
            return 0;
    }
    return 1;
}

/* What is known of lights and sky during the exposure on the plane that fills a tile; whether they
 * leave all of it as it is in the sharp frame. */
static int light_plane(const FrameState *state, int tile, TileContent *content) {
    int32_t triangle = content->triangle;
    const Scene *scene = state->scene;
    Vec3 corners[4];
    PlaneLight light;
    uint32_t lamps;
    if (!enclose_moving_plane(state, tile, triangle, corners))
        return 0;
    if (state->frame->has_shadows)
        content->proof = prove_lights(state, triangle, corners, 0);
    content->is_open = content->is_open || !has_occlusion(scene, triangle) ||
                       find_sky_view(scene, triangle, corners) == SKY_OPEN;
    int is_plain = content->is_open && content->object == OBJECT_NONE && !has_fog(state) &&
                   !(scene->mesh->arrays.flags[triangle] & FACET_TEXTURED) &&
                   !is_glossy(state, triangle);
    if (!is_plain || (state->measures->blurs_unseen_shadows && content->proof.hidden) ||
        !find_light_beside_lamps(state, triangle, content->proof, &light, &lamps))
        return 0;
    for (int i = 0; i < scene->num_lights; i++)
        if (i < 32 && lamps >> i & 1 && !is_even(&scene->lights[i], corners))
            return 0;
    return 1;
}

void blur_tile(const FrameState *state, int tile, const TileContent *content, int64_t *num_rays) {
    int32_t number = state->rays->tiles[tile];
    int steps = state->plan->instants[number], wanted = state->plan->masks[number];
    if (!wanted)
        return;
    TileContent lit = *content;
    lit.object = lit.is_shaded ? OBJECT_ANY : lit.object;
    /* Light that is the same at every instant, or changes evenly, is that of the sharp frame. */
    if (lit.triangle >= 0 && light_plane(state, tile, &lit))
        return;
    if (is_single_radiance(state, tile, &lit))
        return;
    FrameState here = *state;
    here.known = find_known_lights(state, tile);
    BlurTile blur; /* not initialized: its units are large */
    blur.state = &here;
    blur.tile = tile;
    blur.top = number / state->rays->tile_columns * TILE_PX;
    blur.order = state->is_rolling ? &state->view->by_row : &state->view->by_cell;
    blur.content = &lit;
    blur.num_rays = num_rays;
    int is_any = 0;
    for (int unit = 0; unit < blur.order->units; unit++) {
        Unit *one = &blur.units[unit];
        one->is_changed = 0;
        one->shadowed = 0;
        one->is_wanted = one->is_active = is_unit_wanted(state, wanted, unit);
        is_any |= one->is_active;
        if (one->is_active)
            begin_unit(&blur, unit);
    }
    if (!is_any)
        return;
    if (!content->triangles)
        blur_units(&blur, steps);
    else if (state->is_rolling)
        blur_listed_rows(&blur, steps);
    else
        blur_listed(&blur, steps);
    write_units(&blur);
}
