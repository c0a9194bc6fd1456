// Provides a corner of the mirror mesh as the capture camera sees it, with the looked-up direction.
// Twin: catoptra_server.render.raster.mirror_pass.mirror_mesh_clip_positions.
in vec4 clip_position;               // w is the distance from the pinhole along the axis
in vec3 direction_at_corner;
out vec3 direction;                  // interpolated over the flat facet: perspective-correct by w

void main()
{
    gl_Position = clip_position;
    direction = direction_at_corner;
}
