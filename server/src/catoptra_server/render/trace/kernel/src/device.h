/* Embree's device, the pool of threads, and meshes committed to the device. */
#ifndef CATOPTRA_DEVICE_H
#define CATOPTRA_DEVICE_H

#include "embree.h"
#include "kernel.h"
#include "workers.h"

#include <stddef.h>

enum { ERROR_SIZE = 256 };

struct Device {
    Embree embree;
    RTCDevice rtc;
    Workers *workers;
    int packet_width;
};

struct Mesh {
    MeshArrays arrays;
    Device *device;
    RTCScene scene; /* NULL for a mesh without triangles */
};

/* Embree's pending error in words, or NULL. */
const char *device_error(const Device *device);

#endif
