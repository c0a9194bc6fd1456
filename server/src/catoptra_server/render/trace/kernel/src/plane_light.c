/* Provides plane_light.h: facets of one radiance over a part of the image.
 * Float64 twin: world/shading.py:facet_radiance. Owns nothing: writes what its caller passes.
 * Threads: any thread of the pool, each for tiles of its own. */
#include "plane_light.h"

/* What is known of a light that shines on a facet; the first 32 lights have a bit. */
static int known_of(int light, LightProof proof) {
    if (light >= 32)
        return LIGHT_UNKNOWN;
    return proof.seen >> light & 1     ? LIGHT_SEEN
           : proof.hidden >> light & 1 ? LIGHT_HIDDEN
                                       : LIGHT_UNKNOWN;
}

static Vec3 reflect(const FrameState *state, const Light *light, int32_t triangle, float cosine) {
    Vec3 albedo = vec3(state->scene->mesh->arrays.albedo + 3 * (size_t)triangle);
    return scale(cosine, multiply(albedo, vec3(light->intensity)));
}

/* Whether the radiance varies over a facet because of a light. */
static int is_varying(const FrameState *state, const Light *light, int known) {
    /* The light of a point light is never the same all over a facet; nor is what is lost of it. */
    if (light->kind == LIGHT_POINT)
        return known != LIGHT_HIDDEN || state->frame->measures_shadows;
    return state->frame->has_shadows && known == LIGHT_UNKNOWN;
}

/* Light of lights that is the same all over a facet; with `lamps`, point lights may be others. */
static int add_lights(const FrameState *state, int32_t triangle, LightProof proof,
                      PlaneLight *found, uint32_t *lamps) {
    const Scene *scene = state->scene;
    uint8_t flags = scene->mesh->arrays.flags[triangle];
    *found = (PlaneLight){vec3(scene->sharp_radiance + 3 * (size_t)triangle), {0, 0, 0}, 1};
    if (flags & FACET_COMPUTED)
        return 0;
    if (flags & FACET_UNLIT)
        return 1;
    Vec3 seen = {0, 0, 0};
    for (int i = 0; i < scene->num_lights; i++) {
        const Light *light = &scene->lights[i];
        float incidence = find_incidence(state, light, triangle);
        int known = known_of(i, proof);
        if (!(incidence > 0.0f))
            continue;
        if (lamps && light->kind == LIGHT_POINT && i < 32 &&
            !(state->frame->has_shadows && known == LIGHT_UNKNOWN)) {
            *lamps |= (uint32_t)(known != LIGHT_HIDDEN) << i;
            found->is_table &= known != LIGHT_HIDDEN;
            continue;
        }
        if (is_varying(state, light, known))
            return 0;
        if (!state->frame->has_shadows)
            continue;
        found->is_table &= known == LIGHT_SEEN;
        Vec3 *sum = known == LIGHT_SEEN ? &seen : &found->lost;
        if (light->kind == LIGHT_DIRECTIONAL)
            *sum = add(*sum, reflect(state, light, triangle, incidence));
    }
    if (!found->is_table)
        found->radiance = add(vec3(scene->ambient_radiance + 3 * (size_t)triangle), seen);
    return 1;
}

int find_plane_light(const FrameState *state, int32_t triangle, LightProof proof,
                     PlaneLight *found) {
    return add_lights(state, triangle, proof, found, NULL);
}

int find_light_beside_lamps(const FrameState *state, int32_t triangle, LightProof proof,
                            PlaneLight *found, uint32_t *lamps) {
    *lamps = 0;
    return add_lights(state, triangle, proof, found, lamps);
}

int is_light_proven(const FrameState *state, int32_t triangle, LightProof proof) {
    if (state->scene->mesh->arrays.flags[triangle] & FACET_UNLIT)
        return 1;
    for (int i = 0; i < state->scene->num_lights; i++)
        if (find_incidence(state, &state->scene->lights[i], triangle) > 0.0f &&
            known_of(i, proof) == LIGHT_UNKNOWN)
            return 0;
    return 1;
}
