/* Provides Embree's device, meshes, and the sizes that Python checks before it calls anything
 * else.
 * No twin. The device owns the pool and Embree's handles, a mesh its scene; Python keeps the
 * mesh's arrays alive until it is released.
 * Threads: the calling thread; a mesh is only read afterwards. */
#include "device.h"

#include "image.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int32_t catoptra_abi(int32_t structure) {
    static const int32_t sizes[] = {
        sizeof(MeshArrays), sizeof(TextureLevel), sizeof(Texture), sizeof(Light), sizeof(Surfaces),
        sizeof(OcclusionPatch), sizeof(Occlusion),
        sizeof(Scene),      sizeof(RayTable), sizeof(Pose), sizeof(Labels), sizeof(Flow), sizeof(Frame), sizeof(FrameCounts),
        sizeof(ImageStage), sizeof(ImageJob),
    };
    int32_t count = sizeof sizes / sizeof *sizes;
    return structure >= 0 && structure < count ? sizes[structure] : -1;
}

static const char *const ERRORS[] = {
    NULL,        "unknown error",         "invalid argument",        "invalid operation",
    "out of memory", "unsupported processor", "cancelled",
};

const char *device_error(const Device *device) {
    int code = device->embree.get_device_error(device->rtc);
    size_t known = sizeof ERRORS / sizeof *ERRORS;
    return code >= 0 && (size_t)code < known ? ERRORS[code] : "unknown error";
}

/* Packets wider than the vector registers are slower than packets that fit. */
static int widest_packet(const Device *device) {
    if (device->embree.get_device_property(device->rtc, RTC_DEVICE_PROPERTY_NATIVE_RAY16))
        return 16;
    if (device->embree.get_device_property(device->rtc, RTC_DEVICE_PROPERTY_NATIVE_RAY8))
        return 8;
    return 4;
}

Device *catoptra_open(const char *embree_path, const char *instruction_set, int32_t threads,
                      int32_t packet_width, char *error) {
    Device *device = calloc(1, sizeof *device);
    if (!device) {
        snprintf(error, ERROR_SIZE, "out of memory");
        return NULL;
    }
    if (!embree_open(&device->embree, embree_path, error, ERROR_SIZE)) {
        free(device);
        return NULL;
    }
    char config[64];
    snprintf(config, sizeof config, "threads=%d,isa=%s", (int)threads, instruction_set);
    device->rtc = device->embree.new_device(config);
    if (!device->rtc) {
        snprintf(error, ERROR_SIZE, "Embree has no device for the instruction set %s",
                 instruction_set);
        free(device);
        return NULL;
    }
    device->packet_width = packet_width ? packet_width : widest_packet(device);
    device->workers = workers_create(threads);
    if (!device->workers) {
        snprintf(error, ERROR_SIZE, "out of memory");
        device->embree.release_device(device->rtc);
        free(device);
        return NULL;
    }
    return device;
}

void catoptra_close(Device *device) {
    workers_destroy(device->workers);
    device->embree.release_device(device->rtc);
    free(device);
}

int32_t catoptra_packet_width(const Device *device) { return device->packet_width; }

/* Corners are not shared between facets: the index buffer only counts. */
static int attach_triangles(const Device *device, RTCScene scene, const MeshArrays *arrays) {
    const Embree *embree = &device->embree;
    size_t count = (size_t)arrays->num_triangles;
    RTCGeometry geometry = embree->new_geometry(device->rtc, RTC_GEOMETRY_TYPE_TRIANGLE);
    embree->set_shared_buffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                              arrays->corners, 0, 3 * sizeof(float), 3 * count);
    uint32_t *index = embree->set_new_buffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                             3 * sizeof(uint32_t), count);
    if (!index) {
        embree->release_geometry(geometry);
        return 0;
    }
    for (uint32_t i = 0; i < 3 * (uint32_t)count; i++)
        index[i] = i;
    embree->commit_geometry(geometry);
    embree->attach_geometry_by_id(scene, geometry, 0);
    embree->release_geometry(geometry);
    return 1;
}

Mesh *catoptra_commit_mesh(Device *device, const MeshArrays *arrays, char *error) {
    Mesh *mesh = calloc(1, sizeof *mesh);
    if (!mesh) {
        snprintf(error, ERROR_SIZE, "out of memory");
        return NULL;
    }
    mesh->arrays = *arrays;
    mesh->device = device;
    if (!arrays->num_triangles)
        return mesh;
    mesh->scene = device->embree.new_scene(device->rtc);
    /* No ray slips between two triangles that share an edge. Without it a fan of 240 triangles two
     * centimetres away, a kilometre off the centre of its world, has a hole of seven pixels; frames
     * take as long (0.99 to 1.02 of the time, 850 to a million triangles). */
    device->embree.set_scene_flags(mesh->scene, RTC_SCENE_FLAG_ROBUST);
    int attached = attach_triangles(device, mesh->scene, arrays);
    device->embree.commit_scene(mesh->scene);
    const char *reason = device_error(device);
    if (!attached || reason) {
        snprintf(error, ERROR_SIZE, "%d triangles cannot be committed: %s",
                 (int)arrays->num_triangles, reason ? reason : "out of memory");
        catoptra_release_mesh(mesh);
        return NULL;
    }
    return mesh;
}

void catoptra_release_mesh(Mesh *mesh) {
    if (mesh->scene)
        mesh->device->embree.release_scene(mesh->scene);
    free(mesh);
}
