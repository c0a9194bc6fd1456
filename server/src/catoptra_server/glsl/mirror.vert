// Provides the polygon around the rim circle: no fragment outside the polygon sees the mirror.
// Twin: catoptra_server.render.raster.mirror_pass.rim_polygon.
in vec2 position;

void main()
{
    gl_Position = vec4(position, 0.0, 1.0);
}
