/* Provides catoptra_render and catoptra_trace: a frame, handed out tile by tile, or part by part,
 * to the device's threads.
 * Float64 twin: reference/reference_engine.py. The frame owns its state, plan and lists of
 * candidates, freed before the call returns; outputs are Python's.
 * Threads: the calling thread, which takes part in the pool's work. Passes of several callers
 * follow one another. */
#define _GNU_SOURCE
#include "beam_origins.h"
#include "beams.h"
#include "blur.h"
#include "blur_plan.h"
#include "coverage.h"
#include "encoding.h"
#include "flow.h"
#include "frame_state.h"
#include "instances.h"
#include "labels.h"
#include "light_map.h"
#include "measures.h"
#include "shading.h"
#include "tiles.h"

#include <math.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

/* Parts of the picture of which one, in each direction another, decides what need be measured. */
enum { SAMPLED_PARTS = 5, ALL_PARTS = 0, SOME_PARTS, OTHER_PARTS };
/* Tiles that a thread takes at once: few enough that none waits long for the last. */
enum { TILES_AT_ONCE = 32 };
/* Between measured poses a viewpoint moves along chords: this much more than enough. */
#define MOTION_RESERVE 1.01f

/* What the proofs of some parts have in common: a viewpoint, and boxes of objects. */
typedef struct {
    FrameState state;
    CandidateList objects;
} Band;

typedef struct {
    const FrameState *state;
    const View *view;
    const Band *bands;  /* one, or one of each row of parts; NULL without proofs */
    int num_bands, max_boxes;
    int is_second_pass; /* of a moving frame: the tiles that its plan wants */
    int parts;          /* ALL_PARTS, or SOME_PARTS, of every SAMPLED_PARTS one, or the others */
    atomic_int next;
    atomic_int num_filled;
    atomic_int failed;
    atomic_llong num_rays;
} Job;

static void render_parts(void *argument) {
    Job *job = argument;
    const BeamLevel *parts = &job->view->levels[BEAM_LEVELS - 1];
    int64_t num_rays = 0;
    Search *search = create_search(job->state, job->max_boxes);
    if (!search) {
        atomic_store(&job->failed, 1);
        return;
    }
    int part, filled = 0;
    while ((part = atomic_fetch_add(&job->next, 1)) < parts->rows * parts->columns) {
        int is_sampled = (part / parts->columns * 2 + part % parts->columns) % SAMPLED_PARTS == 0;
        if (job->parts != ALL_PARTS && is_sampled != (job->parts == SOME_PARTS))
            continue;
        const Band *band = job->bands + (job->num_bands > 1 ? part / parts->columns : 0);
        aim_search(search, &band->state, &band->objects, job->is_second_pass ? &num_rays : NULL);
        filled += render_part(search, job->view, part);
    }
    atomic_fetch_add(&job->num_filled, filled);
    atomic_fetch_add(&job->num_rays, num_rays);
    release_search(search);
}

static void for_each_tile(Job *job, void (*visit)(const FrameState *, int)) {
    int count = job->view->rays.num_tiles, first;
    while ((first = atomic_fetch_add(&job->next, TILES_AT_ONCE)) < count) {
        int end = first + TILES_AT_ONCE < count ? first + TILES_AT_ONCE : count;
        for (int tile = first; tile < end; tile++)
            visit(job->state, tile);
    }
}

static void render_unknown(const FrameState *state, int tile) {
    render_tile(state, tile, &UNKNOWN_CONTENT);
}

static void render_tiles(void *job) { for_each_tile(job, render_unknown); }

static void blur_tiles(void *argument) {
    Job *job = argument;
    int64_t num_rays = 0;
    int count = job->view->rays.num_tiles, first;
    while ((first = atomic_fetch_add(&job->next, TILES_AT_ONCE)) < count)
        for (int tile = first; tile < first + TILES_AT_ONCE && tile < count; tile++)
            blur_tile(job->state, tile, &UNKNOWN_CONTENT, &num_rays);
    atomic_fetch_add(&job->num_rays, num_rays);
}

static void trace_tiles(void *job) { for_each_tile(job, trace_tile); }

static void choose_tiles(void *job) { for_each_tile(job, choose_cells); }

static int has_lights(const Scene *scene, int kind) {
    for (int i = 0; i < scene->num_lights; i++)
        if (scene->lights[i].kind == kind && scene->lights[i].lights_scene)
            return 1;
    return 0;
}

static int begin_frame(FrameState *state, Device *device, const Scene *scene, const View *view,
                       const Frame *frame, char *error) {
    int has_point_lights = has_lights(scene, LIGHT_POINT);
    int is_moving = !view->rays.times && frame->num_poses > 1 &&
                    (frame->exposure > 0.0f || frame->readout > 0.0f);
    prepare_encoding();
    *state = (FrameState){
        .device = device,
        .scene = scene,
        .rays = &view->rays,
        .frame = frame,
        .view = view,
        .camera = frame->camera[0],
        .has_one_pose = !view->rays.times,
        .plan_wanted = is_moving,
        .is_rolling = is_moving && frame->readout > 0.0f,
        .has_point_lights = has_point_lights,
        .is_constant = !has_point_lights && !frame->has_shadows,
    };
    if (has_origin(state))
        state->scene = state->placed = place_scene(scene, frame->origin);
    if (!state->scene) {
        snprintf(error, ERROR_SIZE, "out of memory");
        return 0;
    }
    if (is_moving)
        *state = at_instant(state, 0.5f);
    state->object_radiance = light_objects(state);
    int failed = 0;
    state->objects = create_instances(frame, &failed);
    state->object_heights = raise_objects(state, &failed);
    if (is_moving && frame->output < OUTPUT_HITS) {
        state->plan = create_plan(state);
        failed |= !state->plan;
    }
    if (failed)
        snprintf(error, ERROR_SIZE, "out of memory");
    return !failed;
}

static void end_frame(FrameState *state) {
    release_plan(state->plan);
    free((void *)state->object_heights);
    free(state->object_radiance);
    release_instances(state->objects);
    free(state->placed);
}

/* Largest displacement of the viewpoint, and chord of its turns, from the state's camera. */
static void measure_motion(FrameState *state, float begin, float end) {
    int steps = 2 * state->frame->num_poses;
    for (int i = 0; i <= steps; i++) {
        FrameState moved = at_instant(state, begin + (end - begin) * (float)i / (float)steps);
        Vec3 shift = subtract(vec3(moved.camera.translation), vec3(state->camera.translation));
        float squared = 0.0f;
        for (int entry = 0; entry < 9; entry++) {
            float turn = moved.camera.rotation[entry] - state->camera.rotation[entry];
            squared += turn * turn;
        }
        state->shift = fmaxf(state->shift, sqrtf(dot(shift, shift)));
        state->turn = fmaxf(state->turn, sqrtf(0.5f * squared));
    }
    /* Between the poses that were measured; and never zero, which means a still viewpoint. */
    state->shift = MOTION_RESERVE * state->shift + 1e-9f;
    state->turn = MOTION_RESERVE * state->turn + 1e-9f;
}

static void free_bands(Band *bands, int count) {
    for (int i = 0; bands && i < count; i++)
        candidates_free(&bands[i].objects);
    free(bands);
}

/* The state of a band's proofs: of all its rows' times, and their exposures in the second pass. */
static FrameState begin_band(const FrameState *state, int band, int num_bands, float exposure) {
    FrameState result = *state;
    float rows = (float)(TILE_PX << (BEAM_LEVELS - 1)), top = rows * (float)band;
    float begin = num_bands > 1 ? row_time(state, top) : 0.5f;
    float end = num_bands > 1 ? row_time(state, top + rows) : 0.5f;
    if (!state->plan || (begin == end && exposure == 0.0f))
        return result;
    result = at_instant(state, 0.5f * (begin + end));
    measure_motion(&result, begin - 0.5f * exposure, end + 0.5f * exposure);
    return result;
}

static Band *create_bands(Job *job, float exposure) {
    int count = job->state->is_rolling ? job->view->levels[BEAM_LEVELS - 1].rows : 1;
    Band *bands = calloc((size_t)count, sizeof *bands);
    job->num_bands = count;
    job->max_boxes = 0;
    for (int i = 0; bands && i < count; i++) {
        bands[i].state = begin_band(job->state, i, count, exposure);
        if (!candidates_collect(&bands[i].objects, &bands[i].state)) {
            free_bands(bands, i);
            return NULL;
        }
        int found = bands[i].objects.count;
        job->max_boxes = found > job->max_boxes ? found : job->max_boxes;
    }
    return bands;
}

/* Render the tiles of one pass, those of proven parts without rays; 0 if memory is short. */
static int run_pass(Device *device, Job *job, float exposure) {
    Band *bands = NULL;
    atomic_store(&job->next, 0);
    if (can_prove_coverage(job->state)) {
        job->bands = bands = create_bands(job, exposure);
        if (!bands)
            return 0;
        /* What moves is blurred by the whole sharp frame's measures. */
        if (job->state->frame->ends_measures && !job->state->plan) {
            job->parts = SOME_PARTS;
            workers_run(device->workers, render_parts, job);
            end_measures(job->state);
            job->parts = OTHER_PARTS;
            atomic_store(&job->next, 0);
        }
        workers_run(device->workers, render_parts, job);
    } else {
        void (*visit)(void *) = job->is_second_pass ? blur_tiles : render_tiles;
        if (job->view->rays.num_tiles <= TILES_AT_ONCE)
            workers_run_alone(visit, job);
        else
            workers_run(device->workers, visit, job);
    }
    free_bands(bands, job->num_bands);
    return !atomic_load(&job->failed);
}

static float elapsed_ms(const struct timespec *begin) {
    struct timespec end;
    clock_gettime(CLOCK_MONOTONIC, &end);
    return 1e3f * (float)(end.tv_sec - begin->tv_sec) +
           1e-6f * (float)(end.tv_nsec - begin->tv_nsec);
}

/* The second pass of a moving frame: tiles that its motion changes, at many instants. */
static int blur_frame(Device *device, Job *job, FrameCounts *counts) {
    const BlurPlan *plan = job->state->plan;
    struct timespec begin;
    clock_gettime(CLOCK_MONOTONIC, &begin);
    job->is_second_pass = 1;
    struct Measures *measures = job->state->measures;
    measures->blurs_unseen_shadows =
        job->state->frame->has_shadows && job->state->frame->measures_shadows &&
        is_counted(&measures->shadow, &job->state->frame->limits);
    int is_done = choose_instants(job->state);
    if (is_done) {
        atomic_store(&job->next, 0);
        workers_run(device->workers, choose_tiles, job);
        want_tiles(job->state);
    }
    is_done = is_done && (!plan->num_tiles || run_pass(device, job, job->state->frame->exposure));
    if (is_done && reopen_gathered(job->state))
        is_done = run_pass(device, job, job->state->frame->exposure);
    counts->num_blurred_tiles = plan->num_tiles;
    counts->num_instants = plan->max_instants;
    counts->num_blur_rays = atomic_load(&job->num_rays);
    counts->blur_ms = elapsed_ms(&begin);
    return is_done;
}

static int render_all(Device *device, const FrameState *state, const View *view,
                      FrameCounts *counts) {
    Job job = {.state = state, .view = view};
    if (state->frame->labels)
        label_beside_view(state->frame->labels, view);
    if (state->frame->flow)
        flow_beside_view(state->frame->flow, view);
    if (!run_pass(device, &job, 0.0f))
        return 0;
    counts->num_tiles = view->rays.num_tiles;
    counts->num_filled_tiles = atomic_load(&job.num_filled);
    return !state->plan || blur_frame(device, &job, counts);
}

int32_t catoptra_render(Device *device, const Scene *scene, const View *view, const Frame *frame,
                        FrameCounts *counts, char *error) {
    FrameState state;
    struct Measures measures;
    memset(&measures, 0, sizeof measures);
    int is_ready = begin_frame(&state, device, scene, view, frame, error);
    state.measures = &measures;
    int is_rendered = is_ready && render_all(device, &state, view, counts);
    if (is_ready && !is_rendered)
        snprintf(error, ERROR_SIZE, "out of memory");
    int pixels = view->rays.width_px * view->rays.height_px;
    counts->shadow_change = conclude_change(&measures.shadow, &frame->limits, pixels);
    int skips_lamps = atomic_load(&measures.skips_lamps);
    float unseen = skips_lamps ? UNSEEN_PART * frame->limits.plain_change : 0.0f;
    counts->shadow_change.largest += unseen;
    if (unseen > VISIBLE_LEVELS)
        counts->shadow_change.num_visible = pixels;
    counts->fog_change = conclude_change(&measures.fog, &frame->limits, pixels);
    counts->gloss_change = conclude_change(&measures.gloss, &frame->limits, pixels);
    counts->light_change = find_light_change(&state, pixels);
    counts->blur_change = conclude_change(&measures.blur, &frame->limits, pixels);
    if (is_ready && state.plan)
        counts->rolling_change = conclude_change(&state.plan->rolling, &frame->limits, pixels);
    counts->watched_change = conclude_change(&measures.watched, &frame->limits, pixels);
    counts->shows_watched = atomic_load(&measures.shows_watched);
    counts->ended_measures = measures.ended;
    counts->drops_layers = atomic_load(&measures.drops_layers);
    end_frame(&state);
    return !is_rendered;
}

int32_t catoptra_trace(Device *device, const Scene *scene, const View *view, const Frame *frame,
                       char *error) {
    FrameState state;
    if (begin_frame(&state, device, scene, view, frame, error)) {
        Job job = {.state = &state, .view = view};
        workers_run(device->workers, trace_tiles, &job);
    }
    end_frame(&state);
    return 0;
}
