/* Provides the device, meshes, and the sizes that Python checks before it calls anything
 * else.
 * No twin. The device owns the pool, a mesh its hierarchy; Python keeps the
 * mesh's arrays alive until it is released.
 * Threads: the calling thread; a mesh is only read afterwards. */
#include "device.h"

#include "image.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int32_t catoptra_abi(int32_t structure) {
    static const int32_t sizes[] = {
        sizeof(MeshArrays),  sizeof(TextureLevel), sizeof(Texture),        sizeof(Light),
        sizeof(FacetSource), sizeof(Surfaces),     sizeof(OcclusionPatch), sizeof(Occlusion),
        sizeof(Scene),       sizeof(RayTable),     sizeof(Pose),           sizeof(Labels),
        sizeof(Flow),        sizeof(ChangeLimits), sizeof(PixelChange),    sizeof(Frame),
        sizeof(FrameCounts), sizeof(ImageStage),   sizeof(ImageJob),       sizeof(RestingSide),
        sizeof(Sinking),     sizeof(BakeLamp),     sizeof(BakeJob),        sizeof(GatherJob),
    };
    int32_t count = sizeof sizes / sizeof *sizes;
    return structure >= 0 && structure < count ? sizes[structure] : -1;
}

Device *catoptra_open(int32_t threads, char *error) {
    Device *device = calloc(1, sizeof *device);
    if (device)
        device->workers = workers_create(threads);
    if (device && device->workers)
        return device;
    free(device);
    snprintf(error, ERROR_SIZE, "out of memory");
    return NULL;
}

void catoptra_close(Device *device) {
    workers_destroy(device->workers);
    free(device);
}

Mesh *catoptra_commit_mesh(Device *device, const MeshArrays *arrays, char *error) {
    Mesh *mesh = calloc(1, sizeof *mesh);
    if (mesh && build_bvh(&mesh->bvh, device->workers, arrays->corners, arrays->fine_corners,
                          arrays->num_triangles)) {
        mesh->arrays = *arrays;
        mesh->bvh.filter = arrays->coverage ? &mesh->arrays : NULL;
        return mesh;
    }
    free(mesh);
    snprintf(error, ERROR_SIZE, "%d triangles cannot be committed: out of memory",
             (int)arrays->num_triangles);
    return NULL;
}

void catoptra_repaint_mesh(Mesh *mesh, const MeshArrays *arrays) { mesh->arrays = *arrays; }

void catoptra_release_mesh(Mesh *mesh) {
    free_bvh(&mesh->bvh);
    free(mesh);
}
