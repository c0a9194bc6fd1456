// Provides vec2 atlas_coordinates(vec3 direction): texture coordinates of a mirror-frame direction.
// Twin: catoptra_server.render.projection.atlas.Atlas.texels_from_direction, over the atlas' size.
uniform vec4 face_texel_transform[NUM_FACES];  // texel position of a face's centre; texels per unit
uniform vec2 atlas_texel;                      // one over the atlas' width and height

// In the face's own axes the direction is (forward, right, down). The largest forward component
// wins, the first of equals. The upward face takes part only where the atlas has one.
vec2 atlas_coordinates(vec3 direction)
{
    vec3 local = direction;
    vec4 transform = face_texel_transform[0];
    if (direction.y > local.x) {
        local = vec3(direction.y, -direction.x, direction.z);
        transform = face_texel_transform[1];
    }
    if (-direction.x > local.x) {
        local = vec3(-direction.x, -direction.y, direction.z);
        transform = face_texel_transform[2];
    }
    if (-direction.y > local.x) {
        local = vec3(-direction.y, direction.x, direction.z);
        transform = face_texel_transform[3];
    }
    if (direction.z > local.x) {
        local = vec3(direction.z, direction.y, -direction.x);
        transform = face_texel_transform[4];
    }
#if NUM_FACES > 5
    if (-direction.z > local.x) {
        local = vec3(-direction.z, direction.y, direction.x);
        transform = face_texel_transform[5];
    }
#endif
    // Without the upward face a coarse mirror mesh may look past a side face's upper edge: clamp to
    // the face's last row, as a clamped texture would.
    vec2 st = clamp(local.yz / max(local.x, 1e-30), -1.0, 1.0);
    return (transform.xy + st * transform.zw) * atlas_texel;
}
