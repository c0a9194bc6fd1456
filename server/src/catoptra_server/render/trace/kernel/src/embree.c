/* Provides embree.h: look-up of Embree's functions in the library that the Python package embreex
 * brings along.
 * No twin. The handle of the library stays open for the life of the process.
 * Threads: the thread that opens the device. */
#include "embree.h"

#include <dlfcn.h>
#include <stdio.h>
#include <string.h>

typedef struct {
    const char *name;
    size_t offset;
} Symbol;

#define SYMBOL(NAME, MEMBER) {NAME, offsetof(Embree, MEMBER)}

static const Symbol SYMBOLS[] = {
    SYMBOL("rtcNewDevice", new_device),
    SYMBOL("rtcReleaseDevice", release_device),
    SYMBOL("rtcGetDeviceError", get_device_error),
    SYMBOL("rtcGetDeviceProperty", get_device_property),
    SYMBOL("rtcNewScene", new_scene),
    SYMBOL("rtcReleaseScene", release_scene),
    SYMBOL("rtcCommitScene", commit_scene),
    SYMBOL("rtcSetSceneBuildQuality", set_scene_build_quality),
    SYMBOL("rtcSetSceneFlags", set_scene_flags),
    SYMBOL("rtcAttachGeometryByID", attach_geometry_by_id),
    SYMBOL("rtcNewGeometry", new_geometry),
    SYMBOL("rtcReleaseGeometry", release_geometry),
    SYMBOL("rtcCommitGeometry", commit_geometry),
    SYMBOL("rtcSetSharedGeometryBuffer", set_shared_buffer),
    SYMBOL("rtcSetNewGeometryBuffer", set_new_buffer),
    SYMBOL("rtcSetGeometryInstancedScene", set_instanced_scene),
    SYMBOL("rtcSetGeometryTimeStepCount", set_time_step_count),
    SYMBOL("rtcSetGeometryTransform", set_transform),
    SYMBOL("rtcIntersect1", intersect1),
    SYMBOL("rtcIntersect4", intersect4),
    SYMBOL("rtcIntersect8", intersect8),
    SYMBOL("rtcIntersect16", intersect16),
    SYMBOL("rtcOccluded1", occluded1),
    SYMBOL("rtcOccluded4", occluded4),
    SYMBOL("rtcOccluded8", occluded8),
    SYMBOL("rtcOccluded16", occluded16),
};

int embree_open(Embree *embree, const char *path, char *error, size_t error_size) {
    /* Never closed: other modules of the process may use the same library. */
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!library) {
        snprintf(error, error_size, "%s", dlerror());
        return 0;
    }
    for (size_t i = 0; i < sizeof SYMBOLS / sizeof *SYMBOLS; i++) {
        void *address = dlsym(library, SYMBOLS[i].name);
        if (!address) {
            snprintf(error, error_size, "%s has no function %s", path, SYMBOLS[i].name);
            return 0;
        }
        /* ISO C has no conversion from object to function pointers; POSIX promises the bytes. */
        memcpy((char *)embree + SYMBOLS[i].offset, &address, sizeof address);
    }
    return 1;
}
