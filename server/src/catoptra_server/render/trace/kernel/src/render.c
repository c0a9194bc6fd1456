/* A frame: the work is handed out tile by tile, or part by part, to the device's threads. */
#include "beams.h"
#include "coverage.h"
#include "frame_state.h"
#include "light_map.h"
#include "measures.h"
#include "shading.h"
#include "tiles.h"

#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>

/* Tiles that a thread takes at once: few enough that none waits long for the last. */
enum { TILES_AT_ONCE = 32 };

typedef struct {
    const FrameState *state;
    const View *view;
    const CandidateList *candidates;
    atomic_int next;
    atomic_int num_filled;
    atomic_int failed;
} Job;

static void render_parts(void *argument) {
    Job *job = argument;
    const BeamLevel *parts = &job->view->levels[BEAM_LEVELS - 1];
    Search *search = create_search(job->state, job->candidates);
    if (!search) {
        atomic_store(&job->failed, 1);
        return;
    }
    int part, filled = 0;
    while ((part = atomic_fetch_add(&job->next, 1)) < parts->rows * parts->columns)
        filled += render_part(search, job->view, part);
    atomic_fetch_add(&job->num_filled, filled);
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

static void trace_tiles(void *job) { for_each_tile(job, trace_tile); }

static int has_lights(const Scene *scene, int kind) {
    for (int i = 0; i < scene->num_lights; i++)
        if (scene->lights[i].kind == kind && scene->lights[i].lights_scene)
            return 1;
    return 0;
}

static int begin_frame(FrameState *state, Device *device, const Scene *scene, const View *view,
                       const Frame *frame, char *error) {
    int has_point_lights = has_lights(scene, LIGHT_POINT);
    *state = (FrameState){
        .device = device,
        .scene = scene,
        .rays = &view->rays,
        .frame = frame,
        .has_one_origin = !view->rays.origins && !view->rays.times,
        .has_point_lights = has_point_lights,
        .is_constant = !has_point_lights && !scene->num_textures && !frame->has_shadows &&
                       !scene->mesh->arrays.corner_albedo,
        .objects = commit_objects(device, frame),
    };
    state->object_radiance = light_objects(state);
    const char *reason = device_error(device);
    if (reason)
        snprintf(error, ERROR_SIZE, "the dynamic objects cannot be committed: %s", reason);
    int failed = 0;
    state->object_heights = raise_objects(state, &failed);
    if (failed)
        snprintf(error, ERROR_SIZE, "out of memory");
    return !reason && !failed;
}

static void end_frame(FrameState *state) {
    free((void *)state->object_heights);
    free(state->object_radiance);
    if (state->objects)
        state->device->embree.release_scene(state->objects);
}

/* Render all tiles, those of proven parts without rays; 0 if memory is short. */
static int render_all(Device *device, const FrameState *state, const View *view,
                      FrameCounts *counts) {
    CandidateList candidates;
    Job job = {.state = state, .view = view, .candidates = &candidates};
    int has_proof = can_prove_coverage(state);
    if (has_proof && !candidates_collect(&candidates, state))
        return 0;
    workers_run(device->workers, has_proof ? render_parts : render_tiles, &job);
    if (has_proof)
        candidates_free(&candidates);
    counts->num_tiles = view->rays.num_tiles;
    counts->num_filled_tiles = atomic_load(&job.num_filled);
    return !atomic_load(&job.failed);
}

int32_t catoptra_render(Device *device, const Scene *scene, const View *view, const Frame *frame,
                        FrameCounts *counts, char *error) {
    FrameState state;
    struct Measures measures = {0.0f, 0};
    int is_ready = begin_frame(&state, device, scene, view, frame, error);
    state.measures = &measures;
    int is_rendered = is_ready && render_all(device, &state, view, counts);
    if (is_ready && !is_rendered)
        snprintf(error, ERROR_SIZE, "out of memory");
    counts->shadow_change = atomic_load(&measures.shadow_change);
    counts->shows_watched = atomic_load(&measures.shows_watched);
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
