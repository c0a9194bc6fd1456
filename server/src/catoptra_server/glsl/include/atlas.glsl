// Provides vec2 atlas_position(vec3 direction).
// Twin: catoptra_server.render.raster.atlas.Atlas.texels_from_direction, over the atlas' size.
uniform vec4 face_place[FACES];      // texel position of each face's middle; texels a unit of s, t
uniform vec2 atlas_texel;            // one over the atlas' width and height

// Turned into the face's own axes the direction is (forward, right, down). The largest forward
// wins, the first of equals. The upward face takes part only where it is drawn.
vec2 atlas_position(vec3 direction)
{
    vec3 local = direction;
    vec4 place = face_place[0];
    if (direction.y > local.x) {
        local = vec3(direction.y, -direction.x, direction.z);
        place = face_place[1];
    }
    if (-direction.x > local.x) {
        local = vec3(-direction.x, -direction.y, direction.z);
        place = face_place[2];
    }
    if (-direction.y > local.x) {
        local = vec3(-direction.y, direction.x, direction.z);
        place = face_place[3];
    }
    if (direction.z > local.x) {
        local = vec3(direction.z, direction.y, -direction.x);
        place = face_place[4];
    }
#if FACES > 5
    if (-direction.z > local.x) {
        local = vec3(-direction.z, direction.y, direction.x);
        place = face_place[5];
    }
#endif
    // Without the upward face a coarse polygon mirror may look past a side face's upper edge; its
    // last row is shown there, as a clamped texture would.
    vec2 st = clamp(local.yz / max(local.x, 1e-30), -1.0, 1.0);
    return (place.xy + st * place.zw) * atlas_texel;
}
