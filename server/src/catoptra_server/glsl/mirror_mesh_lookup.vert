// Provides a corner of the polygon mirror where the capture camera sees it, and what it looks up.
// Twin: catoptra_server.render.raster.mirror_mesh_lookup.polygon_clip_positions.
in vec4 clip_position;               // w is the distance from the pinhole along the axis
in vec3 looked_up;
out vec3 direction;                  // interpolated over the flat facet: perspective-correct by w

void main()
{
    gl_Position = clip_position;
    direction = looked_up;
}
